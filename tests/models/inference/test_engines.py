import importlib.util
import sys

import jaxtyping
import numpy as np
import pytest
import torch

from models.errors import InputError
from models.inference import engines
from models.inference.ensemble import MeanProbability
from models.networks.unet import UNet
from models.networks.unet3plus import UNet3Plus
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing

NOISE = np.random.default_rng(0).integers(0, 256, (3, 40, 56), dtype=np.uint8)


def networks() -> tuple[torch.nn.Module, ...]:
    torch.manual_seed(0)
    return UNet(width=2, depth=2)().eval(), UNet(width=3, depth=3, normalisation="none")().eval()


@pytest.mark.parametrize("engine", [name for name in engines.PACKAGES if engines.is_installed(name)])
def test_an_engine_gives_the_probabilities_of_torch(engine: str, monkeypatch) -> None:
    # While the exporter traces a network, sizes are tensors, which checks of types refuse.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    for flips in (False, True):
        expected, found = (
            Predictor(networks(), Preprocessing(32), flips=flips, batch_size=2, engine=each).probability(
                NOISE
            )
            for each in ("eager", engine)
        )
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_auto_is_the_fastest_that_is_installed(monkeypatch) -> None:
    there: set[str] = set()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name if name in there else None)
    assert engines.chosen_engine("auto", "cpu") == "eager"
    there |= {"onnxruntime"}
    assert engines.chosen_engine("auto", "cpu") == "eager"
    there |= {"onnx"}
    assert engines.chosen_engine("auto", "cpu") == "onnxruntime"
    there |= {"openvino"}
    assert engines.chosen_engine("auto", "cpu") == engines.FASTEST[0]
    assert engines.chosen_engine("auto", "cuda") == "eager"
    assert engines.chosen_engine("compiled", "cpu") == "compiled"


def test_an_engine_that_is_not_there_is_refused_with_what_to_install(monkeypatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    ensemble = MeanProbability(networks())
    with pytest.raises(InputError, match=r"packages onnx and openvino .*\(pip install 'ctus\[openvino\]'"):
        engines.forward_of(ensemble, "openvino", 32, "cpu")
    with pytest.raises(InputError, match="expected eager or compiled for device cuda, received onnxruntime"):
        engines.forward_of(ensemble, "onnxruntime", 32, "cuda")


def test_the_presence_of_a_guided_network_passes_through_an_ensemble() -> None:
    class Guided(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.inner = UNet3Plus(width=8, depth=2, classification_guided=True)()

        def forward(self, images: torch.Tensor) -> object:
            self.inner.train()
            return self.inner(images)

    images = torch.rand(2, 1, 32, 32)
    with torch.no_grad():
        maps, presence = MeanProbability((Guided(), networks()[0]))(images)
    assert maps.shape == (2, 1, 32, 32) and presence.shape == (2,)
    assert 0 < float(presence.min()) and float(presence.max()) < 1


def test_a_network_of_ours_is_used_without_monai(monkeypatch) -> None:
    for name in ("monai", "lightning", "mlflow", "onnx", "onnxruntime", "openvino"):
        monkeypatch.setitem(sys.modules, name, None)  # an import of it fails
    assert Predictor(networks(), Preprocessing(32), engine="eager")(NOISE).shape == NOISE.shape
