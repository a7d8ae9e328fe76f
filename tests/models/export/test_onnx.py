import jaxtyping
import numpy as np
import pytest
import torch

from models.errors import InputError
from models.export import onnx as export
from models.inference.ensemble import MeanProbability
from models.networks.attention_unet import AttentionUNet
from models.networks.unet import UNet
from models.networks.unet3plus import UNet3Plus

pytest.importorskip("onnxruntime")
RECIPES = [
    UNet(width=2, depth=3),
    AttentionUNet(width=8, depth=3),
    UNet3Plus(width=8, depth=4, classification_guided=True),
]


@pytest.fixture(autouse=True)
def traceable(monkeypatch) -> None:
    """Without checks of types: while the exporter traces a network, sizes are tensors."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: recipe.name)
def test_a_graph_gives_the_networks_outputs_for_any_number_of_images(tmp_path, recipe) -> None:
    torch.manual_seed(0)
    module = MeanProbability((recipe(), UNet(width=2, depth=2)()), flips=True).eval()
    check = export.export_onnx(module, 32, tmp_path / "out" / "model.onnx", {"name": "a"})
    assert (
        0 <= check.max_difference < 1e-5 and check.bytes == (tmp_path / "out" / "model.onnx").stat().st_size
    )
    session = export.onnx_session((tmp_path / "out" / "model.onnx").read_bytes())
    for count in (1, 5):
        images = np.random.default_rng(1).random((count, 1, 32, 32), dtype=np.float32)
        assert export.max_difference(module, session, images) < 1e-5


def test_what_is_known_of_a_model_is_in_the_graphs_metadata(tmp_path) -> None:
    import onnx

    export.export_onnx(
        MeanProbability((UNet(width=2, depth=2)(),)),
        16,
        tmp_path / "m.onnx",
        {"digest": "ab", "licence": "é"},
    )
    model = onnx.load_model(tmp_path / "m.onnx")
    onnx.checker.check_model(model)
    assert {each.key: each.value for each in model.metadata_props} == {"digest": "ab", "licence": "é"}
    assert [output.name for output in model.graph.output] == ["probability"]


def test_a_graph_with_other_outputs_is_not_written(tmp_path, monkeypatch) -> None:
    other = UNet(width=2, depth=2)()
    torch.nn.init.constant_(other.head.bias, 3.0)
    graph = export.onnx_graph(MeanProbability((other,)), 16)
    monkeypatch.setattr(export, "onnx_graph", lambda module, size: graph)
    with pytest.raises(InputError, match=r"m\.onnx: expected a graph with the outputs of its network"):
        export.export_onnx(MeanProbability((UNet(width=2, depth=2)(),)), 16, tmp_path / "m.onnx", {})
    assert not list(tmp_path.iterdir())


def test_a_package_that_is_missing_is_named(monkeypatch) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(export.importlib, "import_module", missing)
    with pytest.raises(InputError, match=r"onnx: expected the package onnx, found none \(pip install"):
        export.onnx_graph(UNet(width=2, depth=2)(), 16)
