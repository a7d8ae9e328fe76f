"""Predictions with logits that are written down, as no network would give them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from experiments.analysis.consolidation.predictions import Prediction, PreparedCases
from models.labelled_frames import LabelledFrames
from models.preprocessing.preprocessing import Preprocessing


def known_prediction(
    logits: Sequence[np.ndarray], masks: Sequence[np.ndarray], groups: Sequence[str], seconds: float = 0.1
) -> Prediction:
    """Square cases at the network's own size, so that nothing is resized."""
    size = masks[0].shape[0]
    frames = LabelledFrames(
        images=tuple(np.full(mask.shape, index, np.uint8) for index, mask in enumerate(masks)),
        masks=tuple(masks),
        case_ids=tuple(f"case{index}" for index in range(len(masks))),
        groups=tuple(groups),
        spacing_mm=(None,) * len(masks),
        simulated=True,
    )
    images = np.zeros((len(masks), size, size), np.float32)
    cases = PreparedCases(frames, Preprocessing(size), images, np.stack(masks), 0.01)
    return Prediction(cases, np.stack(logits).astype(np.float16), seconds)


def disc(size: int, row: float, column: float, radius: float) -> np.ndarray:
    """A mask of a disc."""
    rows, columns = np.mgrid[:size, :size]
    return (rows - row) ** 2 + (columns - column) ** 2 < radius**2
