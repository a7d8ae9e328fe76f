"""Vessel masks from frames, by a trained network."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from models.checkpoint import Checkpoint
from models.errors import InputError
from models.preprocessing import Preprocessing
from models.shapes import Bool, Float32, UInt8


@dataclass(frozen=True)
class Predictor:
    """A network in use: grey frames in, masks or probabilities of the frames' own size out.

    ``batch_size`` frames pass at a time on ``device`` ("cpu", "cuda"); ``threshold`` (0 to 1) is the probability from
    which a pixel is vessel.
    """

    network: nn.Module
    preprocessing: Preprocessing
    batch_size: int = 8
    threshold: float = 0.5
    device: str = "cpu"

    def __post_init__(self) -> None:
        if self.batch_size < 1:
            raise InputError(f"batch_size: expected at least 1, received {self.batch_size}")
        if not 0 <= self.threshold <= 1:
            raise InputError(f"threshold: expected 0 to 1, received {self.threshold}")

    @classmethod
    def load(cls, path: str | Path, batch_size: int = 8, device: str = "cpu") -> Predictor:
        """From a checkpoint file; InputError if it is not one."""
        checkpoint = Checkpoint.load(path)
        network = checkpoint.network().to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        return cls(network, checkpoint.preprocessing, batch_size=batch_size, device=device)

    def __call__(self, frames: UInt8[np.ndarray, "n h w"]) -> Bool[np.ndarray, "n h w"]:
        """The vessel mask of each frame, at the frame's size."""
        masks = np.empty(_checked(frames).shape, dtype=bool)
        for part, probability in self._batches(frames):
            masks[part] = probability >= self.threshold
        return masks

    def probability(self, frames: UInt8[np.ndarray, "n h w"]) -> Float32[np.ndarray, "n h w"]:
        """The probability of vessel, 0 to 1, in each pixel of each frame."""
        probabilities = np.empty(_checked(frames).shape, dtype=np.float32)
        for part, probability in self._batches(frames):
            probabilities[part] = probability
        return probabilities

    def _batches(self, frames: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
        placement = self.preprocessing.placement(*frames.shape[1:])
        self.network.eval()
        for first in range(0, len(frames), self.batch_size):
            part = slice(first, first + self.batch_size)
            with torch.inference_mode():
                images = torch.tensor(frames[part], device=self.device)
                squares = self.preprocessing.normalise(self.preprocessing(images))
                logits = self.network(squares.contiguous(memory_format=torch.channels_last))
                maps = self.preprocessing.restore(torch.sigmoid(logits.float()), placement)
            yield part, maps.cpu().numpy()


def _checked(frames: np.ndarray) -> np.ndarray:
    if frames.dtype != np.uint8 or frames.ndim != 3 or 0 in frames.shape[1:]:
        raise InputError(
            f"frames: expected uint8 of shape (n, height, width), received {frames.dtype} {frames.shape}"
        )
    return frames
