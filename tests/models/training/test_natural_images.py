"""Weights of another program's file under our names, from a package made for the test."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import torch

from models.errors import InputError
from models.networks.efficientnet_unet import EfficientNetUNet
from models.networks.unet import UNet
from models.training.natural_images import FILE, PACKAGE, NaturalImages

RECIPE = EfficientNetUNet(width=2)
OWN = {"expand.0": "_expand_conv", "depthwise.0": "_depthwise_conv", "project.0": "_project_conv"}
OWN |= {"expand.1": "_bn0", "depthwise.1": "_bn1", "project.1": "_bn2"}


def published(generator: torch.Generator) -> dict[str, torch.Tensor]:
    """A file as the package has it, with random numbers."""
    file = {"_conv_stem.weight": torch.rand(32, 3, 3, 3, generator=generator)}
    for name, tensor in RECIPE().encoder.state_dict().items():
        where, _, kind = name.rpartition(".")
        if where.startswith("stem.1"):
            file[f"_bn0.{kind}"] = torch.rand(tensor.shape, generator=generator)
        elif where.startswith("blocks"):
            _, number, own = where.split(".", 2)
            file[f"_blocks.{number}.{OWN[own]}.{kind}"] = torch.rand(tensor.shape, generator=generator)
    file["_bn0.num_batches_tracked"] = torch.tensor(7)
    return {
        **file,
        "_fc.weight": torch.rand(10, 4),
        "_bn1.weight": torch.rand(4),
        "_conv_head.weight": torch.rand(4),
    }


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / PACKAGE / FILE
    path.parent.mkdir(parents=True)
    (tmp_path / PACKAGE / "__init__.py").write_text("")
    torch.save(published(torch.Generator().manual_seed(0)), path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, PACKAGE, raising=False)
    return path


def test_every_weight_of_the_encoder_comes_from_the_file(package: Path) -> None:
    file = torch.load(package, weights_only=True)
    first, second = (NaturalImages()(RECIPE, seed) for seed in (0, 1))
    for name, tensor in first.weights.items():
        assert torch.equal(tensor, second.weights[name]) == (
            name.startswith("encoder") or "bias" in name or ".1.weight" in name or ".4.weight" in name
        ), name
    assert torch.equal(first.weights["encoder.stem.0.weight"], file["_conv_stem.weight"].sum(1, keepdim=True))
    assert torch.equal(
        first.weights["encoder.blocks.3.expand.1.running_var"], file["_blocks.3._bn0.running_var"]
    )
    assert torch.equal(
        first.weights["encoder.blocks.0.depthwise.0.weight"], file["_blocks.0._depthwise_conv.weight"]
    )
    assert [each.name for each in first.trained_on] == ["imagenet"]
    assert first.digest != second.digest and "ImageNet" in first.source


def test_a_grey_image_gives_what_it_gave_in_three_equal_channels(package: Path) -> None:
    file = torch.load(package, weights_only=True)
    grey = torch.rand(1, 1, 9, 9)
    expected = torch.conv2d(grey.expand(-1, 3, -1, -1), file["_conv_stem.weight"], stride=2)
    network = NaturalImages()(RECIPE, 0).network(RECIPE)
    torch.testing.assert_close(network.encoder.stem[0](grey), expected)


def test_other_networks_and_other_files_are_refused(package: Path) -> None:
    with pytest.raises(
        InputError, match="expected model=efficientnet_unet with natural_images, received unet"
    ):
        NaturalImages().require_fit(UNet(width=4, depth=3))
    torch.save({"_conv_stem.weight": torch.zeros(8, 3, 3, 3)}, package)
    with pytest.raises(InputError, match="expected weights of EfficientNet-Lite0, received others"):
        NaturalImages()(RECIPE, 0)
    package.write_bytes(b"damaged")
    with pytest.raises(InputError, match="received a file that can't be read"):
        NaturalImages()(RECIPE, 0)


def test_without_the_package_the_message_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("models.training.natural_images.PACKAGE", "no_such_package_here")
    with pytest.raises(InputError, match=r"pip install 'ctus\[natural-images\]'"):
        NaturalImages().require_fit(RECIPE)
