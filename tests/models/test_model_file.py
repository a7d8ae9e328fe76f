import dataclasses
from pathlib import Path

import pytest
import torch

from models.calibration.temperature import TemperatureScaling
from models.checkpoint import Checkpoint
from models.errors import InputError
from models.model_file import ModelMember, SegmentationModel, model_of
from models.networks.unet import UNet
from models.postprocessing.hysteresis import Hysteresis
from models.postprocessing.morphology import Morphology
from models.postprocessing.options import Option
from models.preprocessing.preprocessing import Preprocessing

RECIPE = UNet(width=2, depth=2)


def member(name: str, seed: int = 0, recipe: UNet = RECIPE) -> ModelMember:
    torch.manual_seed(seed)
    return ModelMember(name, recipe, recipe().state_dict())


def ensemble() -> SegmentationModel:
    return SegmentationModel(
        (member("fold 0"), member("fold 1", 1, UNet(width=3, depth=3))),
        Preprocessing(16, "standard_sector", sector=[[0, 0.1], [0, 0.9], [1, 0.5]], crop=True),
        TemperatureScaling(1.5, -0.25),
        Option(Hysteresis(0.3, 0.6, relative=True), Morphology(min_area_mm2=2.0, fill_holes=True)),
        min_presence=0.4,
        flips=True,
        certificate={"chosen": "ensemble", "margin_dsc": 0.01, "seeds": (0, 1, 2), "per_group": {"a": 0.8}},
        data={"usgra": {"digest": "ab12", "licence": "CC BY 4.0"}},
        notes={"dsc": 0.72, "distilled": False, "threshold": None},
    )


def rewritten(path: Path, **changes: object) -> None:
    torch.save({**torch.load(path, weights_only=True), **changes}, path)


def test_what_was_saved_is_loaded(tmp_path) -> None:
    before = ensemble()
    before.save(tmp_path / "models" / "model.pt")
    after = SegmentationModel.load(tmp_path / "models" / "model.pt")
    for each in dataclasses.fields(SegmentationModel):
        if each.name != "members":
            assert getattr(after, each.name) == getattr(before, each.name), each.name
    assert after.certificate["seeds"] == [0, 1, 2]
    images = torch.rand(2, 1, 16, 16)
    for first, second in zip(before.members, after.members, strict=True):
        assert (first.name, first.recipe) == (second.name, second.recipe)
        assert torch.equal(first.network()(images), second.network()(images))
    assert after.digest == before.digest


def test_the_file_is_read_without_running_code(tmp_path) -> None:
    ensemble().save(tmp_path / "model.pt")
    assert torch.load(tmp_path / "model.pt", weights_only=True)["format"] == "ctus-model"


def test_the_digest_changes_with_all_that_changes_masks_and_nothing_else() -> None:
    model = ensemble()
    renamed = (dataclasses.replace(model.members[0], name="first"), model.members[1])
    alike = [
        dataclasses.replace(model, certificate={}, data={}, notes={}),
        dataclasses.replace(model, members=renamed),
    ]
    assert {each.digest for each in alike} == {model.digest}
    weights = {name: tensor.clone() for name, tensor in model.members[0].weights.items()}
    weights["head.bias"] += 1e-6
    others = [
        dataclasses.replace(model, members=(ModelMember("fold 0", RECIPE, weights), model.members[1])),
        dataclasses.replace(model, members=model.members[:1]),
        dataclasses.replace(model, preprocessing=Preprocessing(16)),
        dataclasses.replace(model, calibration=None),
        dataclasses.replace(model, postprocessing=None),
        dataclasses.replace(model, min_presence=None),
        dataclasses.replace(model, flips=False),
    ]
    assert len({model.digest, *(each.digest for each in others)}) == 1 + len(others)


def test_the_checkpoint_of_a_fold_is_a_model_of_one_network(tmp_path) -> None:
    checkpoint = Checkpoint(RECIPE, RECIPE().state_dict(), Preprocessing(16), {"seed": 3})
    checkpoint.save(tmp_path / "fold_0.pt")
    model = SegmentationModel.load(tmp_path / "fold_0.pt")
    assert model.digest == model_of(checkpoint).digest
    assert [each.name for each in model.members] == ["fold_0"] and model.notes == {"seed": 3}
    assert model.calibration is None and model.postprocessing is None


def test_a_failed_save_leaves_the_file_that_was_there(tmp_path, monkeypatch) -> None:
    path = tmp_path / "model.pt"
    ensemble().save(path)
    before = path.read_bytes()

    def full_disk(content: object, target: Path) -> None:
        target.write_bytes(b"half")
        raise OSError("No space left on device")

    monkeypatch.setattr(torch, "save", full_disk)
    with pytest.raises(OSError, match="No space left"):
        ensemble().save(path)
    assert path.read_bytes() == before and [file.name for file in tmp_path.iterdir()] == ["model.pt"]


def test_refuses_missing_damaged_and_foreign_files(tmp_path) -> None:
    path = tmp_path / "model.pt"
    with pytest.raises(InputError, match=r"model\.pt: expected a model file, found none"):
        SegmentationModel.load(path)
    ensemble().save(path)
    content = path.read_bytes()
    for damaged in (content[:-40], content[: len(content) // 2], b"", b"\x89PNG\r\n" * 100):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"model\.pt: expected a model of this program, received a file"):
            SegmentationModel.load(path)
    for foreign in ({"state_dict": {}}, [1], {"format": ["ctus-model"]}):
        torch.save(foreign, path)
        with pytest.raises(InputError, match="received another program's file"):
            SegmentationModel.load(path)


MEMBER = {"name": "a", "network": "unet", "settings": {"width": 2, "depth": 2}, "weights": {}}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 2}, "expected a model of version 1, received version 2"),
        ({"members": []}, "expected networks of different names, received none"),
        ({"members": [{**MEMBER, "network": "vnet"}]}, "received 'vnet'"),
        ({"members": [{**MEMBER, "weights": 5}]}, "expected the weights of a network by name"),
        ({"members": [MEMBER]}, r"\(a\): expected weights of UNet"),
        ({"members": [MEMBER, MEMBER]}, "different names, received a, a"),
        ({"members": 3}, "known networks and settings"),
        ({"preprocessing": {"image_size_px": "16"}}, "preprocessing.image_size_px: expected a whole number"),
        ({"preprocessing": {"image_size_px": 17}}, "image_size_px: expected a multiple of 2 for fold 0"),
        ({"calibration": {"temperature": -1.0}}, "temperature: expected a positive number"),
        ({"calibration": {"scale": 1.0}}, "received scale"),
        ({"postprocessing": {"hysteresis": {}}}, "'morphology'"),
        ({"min_presence": 2.0}, "min_presence: expected 0 to 1"),
    ],
)
def test_refuses_another_model(tmp_path, changes: dict[str, object], message: str) -> None:
    path = tmp_path / "model.pt"
    ensemble().save(path)
    rewritten(path, **changes)
    with pytest.raises(InputError, match=message):
        SegmentationModel.load(path)


def test_refuses_notes_that_no_file_can_hold() -> None:
    with pytest.raises(InputError, match=r"notes\.scores\[1\]: expected text, numbers, .* received Tensor"):
        SegmentationModel((member("a"),), Preprocessing(16), notes={"scores": [1, torch.zeros(1)]})
