"""Frames with a dark disc for a vessel, so easy that a tiny network learns them within seconds."""

from __future__ import annotations

import numpy as np

from models.labelled_frames import LabelledFrames


def drawn_frames(
    count: int = 24,
    size: tuple[int, int] = (40, 48),
    spacing_mm: tuple[float, float] | None = (0.5, 0.25),
    per_group: int = 3,
    empty: int = 0,
    seed: int = 0,
) -> LabelledFrames:
    """``count`` frames, the first ``empty`` of them without a vessel, in groups of ``per_group``."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[: size[0], : size[1]]
    images, masks = [], []
    for index in range(count):
        centre = rng.uniform(0.3, 0.7, 2) * size
        radius = rng.uniform(0.12, 0.25) * min(size)
        mask = (row - centre[0]) ** 2 + (column - centre[1]) ** 2 < radius**2
        if index < empty:
            mask = np.zeros(size, bool)
        images.append(np.where(mask, 30, 150).astype(np.uint8) + rng.integers(0, 40, size, dtype=np.uint8))
        masks.append(mask)
    return LabelledFrames(
        images=tuple(images),
        masks=tuple(masks),
        case_ids=tuple(f"case{index:02d}" for index in range(count)),
        groups=tuple(f"sweep{index // per_group}" for index in range(count)),
        spacing_mm=(spacing_mm,) * count,
        simulated=True,
    )
