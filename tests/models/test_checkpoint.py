from pathlib import Path

import pytest
import torch

from models.checkpoint import Checkpoint
from models.errors import InputError
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing

RECIPE = UNet(width=4, depth=2)


def saved(path: Path) -> Checkpoint:
    checkpoint = Checkpoint(
        RECIPE, RECIPE().state_dict(), Preprocessing(16, "unit"), {"seed": 0, "validation_dsc": 0.5}
    )
    checkpoint.save(path)
    return checkpoint


def rewritten(path: Path, **changes: object) -> None:
    torch.save({**torch.load(path, weights_only=True), **changes}, path)


def test_what_was_saved_is_loaded_and_gives_the_same_network(tmp_path) -> None:
    path = tmp_path / "runs" / "model.pt"
    before = saved(path)
    after = Checkpoint.load(path)
    assert (after.recipe, after.preprocessing, after.notes) == (RECIPE, before.preprocessing, before.notes)
    expected = RECIPE()
    expected.load_state_dict(dict(before.weights))
    images = torch.rand(2, 1, 16, 16)
    torch.testing.assert_close(after.network()(images), expected.eval()(images))
    assert [file.name for file in path.parent.iterdir()] == ["model.pt"]


def test_the_network_does_not_share_its_weights_with_the_checkpoint(tmp_path) -> None:
    checkpoint = saved(tmp_path / "model.pt")
    network = checkpoint.network()
    with torch.no_grad():
        network.head.bias += 1
    assert not torch.equal(network.head.bias, checkpoint.weights["head.bias"])


def test_loading_draws_no_random_numbers(tmp_path) -> None:
    saved(tmp_path / "model.pt")
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    Checkpoint.load(tmp_path / "model.pt").network()
    assert torch.equal(torch.rand(3), expected)


def test_the_file_can_be_read_without_running_code(tmp_path) -> None:
    saved(tmp_path / "model.pt")
    assert torch.load(tmp_path / "model.pt", weights_only=True)["format"] == "ctus-checkpoint"


def test_a_failed_save_leaves_the_file_that_was_there(tmp_path, monkeypatch) -> None:
    path = tmp_path / "model.pt"
    saved(path)
    before = path.read_bytes()

    def full_disk(content: object, target: Path) -> None:
        target.write_bytes(b"half")
        raise OSError("No space left on device")

    monkeypatch.setattr(torch, "save", full_disk)
    with pytest.raises(OSError, match="No space left"):
        saved(path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["model.pt"]


def test_the_preprocessing_is_loaded_as_it_was_saved(tmp_path) -> None:
    stage = Preprocessing(
        32,
        "standard_sector",
        sector=[[0, 0.1], [0, 0.9], [1, 0.5]],
        overlays="auto",
        crop=True,
        ground_tolerance=3,
    )
    Checkpoint(RECIPE, RECIPE().state_dict(), stage).save(tmp_path / "model.pt")
    assert Checkpoint.load(tmp_path / "model.pt").preprocessing == stage


def test_a_file_from_before_there_was_cleaning_loads_without_any(tmp_path) -> None:
    path = tmp_path / "model.pt"
    saved(path)
    rewritten(path, preprocessing={"image_size_px": 16, "normalisation": "unit"})
    assert Checkpoint.load(path).preprocessing == Preprocessing(16, "unit", sector="none", overlays="none")


@pytest.mark.parametrize("place", [0.02, 0.3, 0.6, 0.9])
def test_refuses_a_file_with_damaged_bytes(tmp_path, place: float) -> None:
    path = tmp_path / "model.pt"
    saved(path)
    content = bytearray(path.read_bytes())
    first = int(place * len(content))
    content[first : first + 200] = bytes(255 - byte for byte in content[first : first + 200])
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"model\.pt: expected"):
        Checkpoint.load(path)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_refuses_a_truncated_file(tmp_path, share: float) -> None:
    path = tmp_path / "model.pt"
    saved(path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"model\.pt: expected a checkpoint of this program"):
        Checkpoint.load(path)


class Malice:
    def __reduce__(self) -> tuple:
        return print, ("run",)


@pytest.mark.parametrize(
    "content", [{"state_dict": {}}, {"format": "other"}, [1, 2], torch.zeros(3), {"format": Malice()}]
)
def test_refuses_a_file_of_another_program(tmp_path, content: object, capsys) -> None:
    path = tmp_path / "model.pt"
    torch.save(content, path)
    with pytest.raises(InputError, match=r"model\.pt: expected a checkpoint of this program"):
        Checkpoint.load(path)
    assert capsys.readouterr().out == ""


def test_refuses_what_is_missing_or_no_checkpoint_at_all(tmp_path) -> None:
    with pytest.raises(InputError, match=r"none\.pt: expected a checkpoint file, found none"):
        Checkpoint.load(tmp_path / "none.pt")
    (tmp_path / "image.pt").write_bytes(b"\x89PNG\r\n" * 100)
    with pytest.raises(InputError, match=r"image\.pt: expected a checkpoint of this program"):
        Checkpoint.load(tmp_path / "image.pt")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 99}, "version 1, received version 99"),
        ({"network": "vnet"}, "known network, received another .*'vnet'"),
        ({"settings": {"layers": 3}}, "known network, received another"),
        ({"preprocessing": {"image_size_px": -1}}, "known network, received another"),
        ({"settings": {"width": 8, "depth": 2, "normalisation": "batch", "dropout": 0.1}}, "weights of UNet"),
        ({"preprocessing": {"image_size_px": 16, "hue": 1}}, "known network, received another .*hue"),
        ({"preprocessing": None}, "known network, received another"),
        ({"weights": {}}, "weights of UNet.* received absent"),
        ({"weights": 5}, "expected the weights of a network by name"),
        ({"weights": {"head.bias": 5}}, "expected the weights of a network by name"),
        ({"weights": {**RECIPE().state_dict(), "extra": torch.zeros(1)}}, "extra absent, received"),
    ],
)
def test_refuses_the_checkpoint_of_another_model(tmp_path, changes: dict[str, object], message: str) -> None:
    path = tmp_path / "model.pt"
    saved(path)
    rewritten(path, **changes)
    with pytest.raises(InputError, match=message):
        Checkpoint.load(path)
