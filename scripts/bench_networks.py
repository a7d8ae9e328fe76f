"""Images a second in a training step and in use, each network next to its peer of equal size in MONAI, in turn."""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import torch
from quick_budget import parsed
from torch import Tensor, nn

from models.networks.attention_unet import AttentionUNet
from models.networks.monai_network import MonaiNetwork
from models.networks.registry import NetworkRecipe
from models.networks.unet import UNet
from models.networks.unet3plus import UNet3Plus
from models.training.deep_supervision import training_loss
from models.training.losses import DiceCrossEntropy

PEERS = {"unet": "BasicUNet", "attention_unet": "AttentionUnet", "unet3plus": "BasicUNetPlusPlus"}
ALIKE = "BasicUNet like ours"
LIKE_OURS = {"norm": "batch", "act": "relu", "bias": False}


def calls(network: nn.Module, given: argparse.Namespace) -> tuple[Callable[[], Tensor], Callable[[], None]]:
    """A training step, which returns its loss, and a pass in use, on images of noise."""
    images = torch.rand(given.batch, 1, given.size, given.size, device=given.device)
    images = images.contiguous(memory_format=torch.channels_last)
    masks = (images > 0.9).float()
    network.to(given.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = torch.optim.AdamW(network.parameters())

    def forward() -> Tensor:
        with torch.autocast(given.device, torch.bfloat16, enabled=given.precision == "bf16"):
            return network(images)

    def step() -> Tensor:
        network.train()
        optimiser.zero_grad()
        loss = training_loss(DiceCrossEntropy(), forward(), masks)
        loss.backward()
        optimiser.step()
        return loss.detach()

    def use() -> None:
        network.eval()
        with torch.inference_mode():
            forward()

    return step, use


def seconds(call: Callable[[], object], device: str) -> float:
    """Wall time of one call, the device's work included."""
    start = time.perf_counter()
    call()
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter() - start


def recipes_of(width: int) -> dict[str, NetworkRecipe]:
    """Ours and MONAI's networks by their names."""
    ours = (UNet(width), AttentionUNet(width), UNet3Plus(width))
    recipes: dict[str, NetworkRecipe] = {recipe.name: recipe for recipe in ours}
    recipes |= {name: MonaiNetwork(name, width) for name in PEERS.values()}
    return {**recipes, ALIKE: MonaiNetwork("BasicUNet", width, LIKE_OURS)}


def main() -> None:
    """Print a line for each network: the medians over the rounds, and the ratios to the peer's."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu", choices=("cpu", "cuda"))
    parser.add_argument("--precision", default="32", choices=("32", "bf16"))
    for name, default in (("size", 128), ("width", 16), ("batch", 8), ("rounds", 5)):
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parsed(parser, {"size": 64, "width": 8, "batch": 2, "rounds": 1})
    networks = {name: recipe() for name, recipe in recipes_of(given.width).items()}
    parts = {name: calls(network, given) for name, network in networks.items()}
    times: dict[str, list[list[float]]] = {name: [[], []] for name in parts}
    for _ in range(given.rounds + 1):
        for name, pair in parts.items():
            for kept, call in zip(times[name], pair, strict=True):
                kept.append(seconds(call, given.device))
    # The first round is to warm up.
    rates = {n: [given.batch / statistics.median(kept[1:]) for kept in both] for n, both in times.items()}
    print(f"{'network':22s}{'parameters':>11s}{'train_img/s':>12s}{'use_img/s':>10s}  peer, ratios in both")
    for name, (train, use) in rates.items():
        size = sum(p.numel() for p in networks[name].parameters())
        peer = PEERS.get(name, "BasicUNet")
        ratios = f"{peer} {train / rates[peer][0]:.2f} {use / rates[peer][1]:.2f}"
        print(f"{name:22s}{size / 1e6:10.2f}M{train:12.1f}{use:10.1f}  {ratios}")


if __name__ == "__main__":
    main()
