from pathlib import Path

import jaxtyping
import numpy as np
import pytest
import torch

from experiments.errors import InputError
from experiments.outcome import Silent
from experiments.studies import export_model
from experiments.tracking import Store
from models.calibration.temperature import TemperatureScaling
from models.export.onnx import onnx_session
from models.model_file import ModelMember, SegmentationModel
from models.networks.unet import UNet
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing


@pytest.fixture(autouse=True)
def traceable(monkeypatch) -> None:
    """Without checks of types: while the exporter traces a network, sizes are tensors."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    recipe = UNet(width=2, depth=2, normalisation="none")
    members = tuple(ModelMember(name, recipe, recipe().state_dict()) for name in "ab")
    whole = SegmentationModel(members, Preprocessing(16, "unit"), TemperatureScaling(2.0))
    whole.save(tmp_path / "in.pt")
    return tmp_path / "in.pt"


def run(model: Path, workspace: Path, register_as: str | None, store: Store) -> export_model.Outcome:
    workspace.mkdir()
    return export_model.run(
        model_path=str(model), title="A", register_as=register_as, seed=0, workspace=workspace,
        progress=Silent(), store=store,
    )  # fmt: skip


def test_graph_card_and_model_are_left_and_agree(tmp_path, model) -> None:
    outcome = run(model, tmp_path / "out", None, Store(enabled=False))
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "model.onnx",
        "model.pt",
        "model_card.md",
    ]
    assert 0 <= outcome.metrics["max_difference"] < 1e-5
    whole = SegmentationModel.load(tmp_path / "out" / "model.pt")
    assert whole.digest == SegmentationModel.load(model).digest
    assert whole.digest in (tmp_path / "out" / "model_card.md").read_text()
    # A frame of the network's size goes through as it is: the graph has the predictor's probability, uncalibrated.
    frame = np.random.default_rng(0).integers(0, 256, (16, 16), dtype=np.uint8)
    (probability,) = onnx_session((tmp_path / "out" / "model.onnx").read_bytes())(
        (frame / 255).astype(np.float32)[None, None]
    )
    logit = np.log(probability / (1 - probability))[0, 0] / 2
    np.testing.assert_allclose(Predictor.load(model).probability(frame), 1 / (1 + np.exp(-logit)), atol=1e-5)


def test_refuses_what_is_no_model_and_a_registry_that_is_off(tmp_path, model) -> None:
    with pytest.raises(InputError, match="model_path: expected a model file"):
        export_model.check(model_path=str(tmp_path / "absent.pt"), register_as=None)
    with pytest.raises(InputError, match="register_as: expected a name"):
        export_model.check(model_path=str(model), register_as=" ")
    with pytest.raises(InputError, match=r"register_as: expected tracking\.enabled=true"):
        run(model, tmp_path / "out", "vessels", Store(enabled=False))
