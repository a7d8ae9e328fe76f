"""Logits of trained networks on labelled frames at the network's size, kept on disk: memory holds one batch."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from numpy.lib.format import open_memmap
from torch import Tensor, nn

from models.array_types import Bool, Float, Float32
from models.calibration import TemperatureScaling, logits_of
from models.labelled_frames import LabelledFrames
from models.preprocessing.preprocessing import Placement, Preprocessing

IDENTITY = TemperatureScaling()


@dataclass(frozen=True, eq=False)
class PreparedCases:
    """Frames as a network takes them, with their masks at that size.

    Parameters
    ----------
    frames : LabelledFrames
        Frames at native size.
    preprocessing : Preprocessing
        Preprocessing that they went through.
    images : ndarray of float32, shape (n, s, s)
        Normalised images.
    masks : ndarray of bool, shape (n, s, s)
        Masks at the network's size.
    seconds_per_frame : float
        Time that the preprocessing of a frame took.
    """

    frames: LabelledFrames
    preprocessing: Preprocessing
    images: Float32[np.ndarray, "n s s"]
    masks: Bool[np.ndarray, "n s s"]
    seconds_per_frame: float

    def __len__(self) -> int:
        return len(self.frames)

    @cached_property
    def placements(self) -> tuple[Placement, ...]:
        """Where each frame lies in the network's square."""
        return tuple(self.preprocessing.placement(*image.shape) for image in self.frames.images)

    def batches(
        self, batch_size: int, indices: Sequence[int] | None = None
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Stream images and masks in order.

        Parameters
        ----------
        batch_size : int
            Number of cases in a batch.
        indices : sequence of int or None, optional
            Cases to stream; None for all.

        Yields
        ------
        images : Tensor, shape (b, 1, s, s)
            Normalised images.
        masks : Tensor, shape (b, 1, s, s)
            Masks of 0 and 1.
        """
        chosen = np.arange(len(self)) if indices is None else np.asarray(indices, dtype=np.int64)
        for first in range(0, len(chosen), batch_size):
            part = chosen[first : first + batch_size]
            yield (
                torch.from_numpy(np.array(self.images[part]))[:, None],
                torch.from_numpy(np.array(self.masks[part]))[:, None].float(),
            )


def prepare(frames: LabelledFrames, preprocessing: Preprocessing, stem: Path) -> PreparedCases:
    """Preprocess frames once, into files.

    Parameters
    ----------
    frames : LabelledFrames
        Frames of any sizes.
    preprocessing : Preprocessing
        What they go through.
    stem : Path
        What the names of the files begin with.

    Returns
    -------
    PreparedCases
        The frames at the network's size.
    """
    size, seconds = preprocessing.image_size_px, 0.0
    shape = (len(frames), size, size)
    images = open_memmap(f"{stem}_images.npy", "w+", np.float32, shape)
    masks = open_memmap(f"{stem}_masks.npy", "w+", np.bool_, shape)
    for index, (image, mask) in enumerate(zip(frames.images, frames.masks, strict=True)):
        begin_s = time.perf_counter()
        square = preprocessing.normalise(preprocessing(torch.tensor(np.array(image, order="C"))[None]))
        seconds += time.perf_counter() - begin_s
        images[index] = square[0, 0].numpy()
        masks[index] = preprocessing.mask(torch.tensor(np.array(mask, order="C"))[None])[0, 0].numpy() > 0
    return PreparedCases(frames, preprocessing, images, masks, seconds / max(len(frames), 1))


@dataclass(frozen=True, eq=False)
class Prediction:
    """Logits of one network, or of the mean probability of several.

    Parameters
    ----------
    cases : PreparedCases
        What was predicted.
    logits : ndarray of float16, shape (n, s, s)
        Logits at the network's size.
    seconds_per_frame : float
        Time of the networks alone.
    """

    cases: PreparedCases
    logits: Float[np.ndarray, "n s s"]
    seconds_per_frame: float

    def windows(self) -> Iterator[tuple[Float32[np.ndarray, "h w"], Bool[np.ndarray, "h w"], str]]:
        """Stream the part of each square that its frame fills.

        Yields
        ------
        logits : ndarray of float32, shape (h, w)
            Logits.
        mask : ndarray of bool, shape (h, w)
            Reference mask.
        group : str
            Group of the case.
        """
        for index, (placement, group) in enumerate(
            zip(self.cases.placements, self.cases.frames.groups, strict=True)
        ):
            window = placement.window
            yield (
                np.asarray(self.logits[index][window], dtype=np.float32),
                np.asarray(self.cases.masks[index][window]),
                group,
            )

    def probability(self, index: int) -> Float32[np.ndarray, "s s"]:
        """Compute the probability of one case at the network's size.

        Parameters
        ----------
        index : int
            Place of the case.

        Returns
        -------
        ndarray of float32, shape (s, s)
            Probability of vessel.
        """
        return _probability(self.logits[index])

    def native(self, index: int, calibration: TemperatureScaling = IDENTITY) -> Float32[np.ndarray, "h w"]:
        """Compute the calibrated probability of one case at its native size, as ``Predictor`` does.

        Parameters
        ----------
        index : int
            Place of the case.
        calibration : TemperatureScaling, optional
            Calibration of the logit.

        Returns
        -------
        ndarray of float32, shape (h, w)
            Probability of vessel.
        """
        probability = torch.from_numpy(self.probability(index))
        restored = self.cases.preprocessing.restore(probability[None, None], self.cases.placements[index])
        native = np.asarray(restored[0].clamp_(0, 1).numpy())
        return native if calibration == IDENTITY else calibration(logits_of(native))


@torch.inference_mode()
def predict(
    network: nn.Module, cases: PreparedCases, path: Path, *, batch_size: int, device: str = "cpu"
) -> Prediction:
    """Compute the logits of one network on all cases.

    Parameters
    ----------
    network : Module
        Trained network; moved to the device and left in evaluation mode.
    cases : PreparedCases
        Cases to predict.
    path : Path
        File for the logits.
    batch_size : int
        Number of cases in a batch.
    device : str, optional
        ``cpu`` or ``cuda``.

    Returns
    -------
    Prediction
        The logits and the time they took.
    """
    network.eval().to(device)
    logits, seconds, done = open_memmap(path, "w+", np.float16, cases.images.shape), 0.0, 0
    for images, _ in cases.batches(batch_size):
        begin_s = time.perf_counter()
        found = network(images.to(device).contiguous(memory_format=torch.channels_last))
        values = found[:, 0].float().cpu().numpy()
        seconds += time.perf_counter() - begin_s
        logits[done : done + len(values)] = values.clip(-6e4, 6e4)
        done += len(values)
    return Prediction(cases, logits, seconds / max(len(cases), 1))


def ensemble(predictions: Sequence[Prediction], path: Path) -> Prediction:
    """Compute the logits of the mean probability of several networks.

    Parameters
    ----------
    predictions : sequence of Prediction
        Predictions of the same cases.
    path : Path
        File for the logits.

    Returns
    -------
    Prediction
        The logits; its time is the sum of all.
    """
    first = predictions[0]
    logits = open_memmap(path, "w+", np.float16, first.logits.shape)
    for index in range(len(logits)):
        mean = np.mean([each.probability(index) for each in predictions], axis=0)
        logits[index] = logits_of(mean)
    return Prediction(first.cases, logits, sum(each.seconds_per_frame for each in predictions))


def _probability(logits: Float[np.ndarray, "s s"]) -> Float32[np.ndarray, "s s"]:
    return np.asarray(torch.sigmoid(torch.from_numpy(np.asarray(logits, dtype=np.float32))).numpy())
