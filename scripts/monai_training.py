"""A training and an inference as one would write them with MONAI: cache, dictionary transforms, a bare loop."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from bench_training import Problem

KEYS = ("image", "mask")


def in_monai(problem: Problem) -> float:
    """Train the problem's network with MONAI's data sets and transforms.

    Parameters
    ----------
    problem : bench_training.Problem
        Network, frames, settings.

    Returns
    -------
    float
        Best validation DSC.
    """
    import torch
    from bench_training import LOSS
    from monai.data import CacheDataset, DataLoader
    from monai.utils import set_determinism

    from models.training.deep_supervision import training_loss
    from models.training.initialisation import initial_network

    set_determinism(0)
    settings = problem.settings
    train, validation = (
        CacheDataset(_entries(frames), chain, progress=False)
        for frames, chain in (
            (problem.train, _chain(problem.stage.image_size_px, True)),
            (problem.validation, _chain(problem.stage.image_size_px, False)),
        )
    )
    batches = DataLoader(train, batch_size=settings.batch_size, shuffle=True, num_workers=0)
    network = initial_network(problem.model, 0).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
    )
    best, step = 0.0, 0
    for _ in range(settings.max_epochs):
        network.train()
        for batch in batches:
            rate = settings.learning_rate * settings.learning_rate_factor(step, len(batches))
            for group in optimiser.param_groups:
                group["lr"] = rate
            loss = training_loss(LOSS, network(_plain(batch["image"])), _plain(batch["mask"]))
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), settings.gradient_clip)
            optimiser.step()
            step += 1
        best = max(best, _dsc(network, DataLoader(validation, batch_size=settings.batch_size)))
    set_determinism(None)
    return best


def file_to_mask(network: Any, size_px: int, paths: list[Path], out: Path) -> None:
    """Read files, segment them in batches and write their masks.

    Parameters
    ----------
    network : torch.nn.Module
        Network in use.
    size_px : int
        Side of its images in px.
    paths : list of Path
        Grey square images.
    out : Path
        Folder of the masks.
    """
    import torch
    from monai.data import PILReader
    from monai.transforms import Compose, LoadImage, NormalizeIntensity, Resize, ScaleIntensityRange
    from PIL import Image

    before = Compose(
        [
            LoadImage(reader=PILReader(reverse_indexing=False), image_only=True, ensure_channel_first=True),
            ScaleIntensityRange(0, 255, 0, 1, clip=True),
            Resize((size_px, size_px), mode="bilinear", anti_aliasing=True),
            NormalizeIntensity(),
        ]
    )
    for begin in range(0, len(paths), 8):
        part = paths[begin : begin + 8]
        images = torch.stack([_plain(before(path)) for path in part])
        with torch.inference_mode():
            logits = network(images.contiguous(memory_format=torch.channels_last))
        for path, found in zip(part, logits, strict=True):
            with Image.open(path) as image:
                native = (image.height, image.width)
            back = Resize(native, mode="bilinear")(found.sigmoid())
            Image.fromarray(np.asarray(_plain(back)[0] > 0.5)).save(out / path.name)


def _entries(frames: Any) -> list[dict[str, Any]]:
    return [dict(zip(KEYS, pair, strict=True)) for pair in zip(frames.images, frames.masks, strict=True)]


def _chain(size_px: int, augmented: bool) -> Any:
    """What is cached, then the augmentation with the probabilities and sizes of ours, then the normalisation."""
    from monai import transforms as monai

    from models.training.augmentation.intensity import Brightness, Contrast, Gamma, Speckle
    from models.training.augmentation.spatial import Affine, Elastic, Flip

    affine, elastic, speckle = Affine(), Elastic(), Speckle()
    gamma, contrast, brightness = Gamma(), Contrast(), Brightness()
    turn, shift_px = math.radians(affine.max_rotation_deg), affine.max_shift * size_px
    modes = {"mode": ("bilinear", "nearest"), "padding_mode": "zeros"}
    random = [
        monai.RandAffined(
            KEYS,
            prob=affine.probability,
            rotate_range=turn,
            scale_range=affine.max_scale_change,
            shear_range=affine.max_shear,
            translate_range=shift_px,
            **modes,
        ),
        monai.RandFlipd(KEYS, prob=Flip().probability, spatial_axis=1),
        monai.Rand2DElasticd(
            KEYS,
            spacing=(size_px / (elastic.control_points - 1),) * 2,
            magnitude_range=(0.0, elastic.max_shift * size_px),
            prob=elastic.probability,
            **modes,
        ),
        monai.RandGaussianNoised("image", prob=speckle.probability, std=speckle.std),
        monai.RandAdjustContrastd(
            "image", prob=gamma.probability, gamma=(1 / (1 + gamma.max_change), 1 + gamma.max_change)
        ),
        monai.RandScaleIntensityd("image", prob=contrast.probability, factors=contrast.max_change),
        monai.RandShiftIntensityd("image", prob=brightness.probability, offsets=brightness.max_change),
    ]
    return monai.Compose(
        [
            monai.EnsureChannelFirstd(KEYS, channel_dim="no_channel"),
            monai.EnsureTyped(KEYS, dtype=(np.float32, np.float32)),
            monai.ScaleIntensityRanged("image", 0, 255, 0, 1, clip=True),
            *(random if augmented else []),
            monai.NormalizeIntensityd("image"),
        ]
    )


def _plain(tensor: Any) -> Any:
    """A tensor without MONAI's record of what was done to it."""
    return tensor.as_tensor() if hasattr(tensor, "as_tensor") else tensor


def _dsc(network: Any, batches: Any) -> float:
    """Mean DSC over images."""
    import torch

    network.eval()
    found = []
    with torch.inference_mode():
        for batch in batches:
            predicted, masks = network(_plain(batch["image"])) > 0, _plain(batch["mask"]) > 0
            both = (predicted & masks).sum((1, 2, 3))
            found += (2 * both / (predicted.sum((1, 2, 3)) + masks.sum((1, 2, 3))).clamp_min(1)).tolist()
    return float(np.mean(found))
