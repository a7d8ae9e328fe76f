"""Vessel masks from frames, by a trained network."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from models.array_types import Bool, Float32, UInt8
from models.checkpoint import Checkpoint
from models.errors import InputError
from models.preprocessing.grey import echo_grey
from models.preprocessing.preprocessing import Preprocessing

CHANNELS = (3, 4)


@dataclass(frozen=True)
class StageTimes:
    """Seconds that each stage of a prediction took; those of several calls add up.

    Parameters
    ----------
    frames : int
        Number of frames.
    preprocessing_s : float
        From the frames as recorded to the network's input.
    network_s : float
        The network alone.
    restoration_s : float
        From the network's output to masks of the frames' own size.
    """

    frames: int = 0
    preprocessing_s: float = 0.0
    network_s: float = 0.0
    restoration_s: float = 0.0

    @property
    def total_s(self) -> float:
        """Seconds of all stages together."""
        return self.preprocessing_s + self.network_s + self.restoration_s

    def __add__(self, other: StageTimes) -> StageTimes:
        return StageTimes(
            self.frames + other.frames,
            self.preprocessing_s + other.preprocessing_s,
            self.network_s + other.network_s,
            self.restoration_s + other.restoration_s,
        )


@dataclass(frozen=True)
class Prediction:
    """Result of a timed prediction.

    Parameters
    ----------
    masks : ndarray of bool, shape (n, h, w)
        Masks of the frames.
    probability : ndarray of float32, shape (n, h, w)
        Probability of vessel, 0 to 1.
    times : StageTimes
        Seconds of each stage.
    """

    masks: Bool[np.ndarray, "n h w"]
    probability: Float32[np.ndarray, "n h w"]
    times: StageTimes


@dataclass(frozen=True)
class Predictor:
    """Trained network in use: frames in, masks or probabilities of the frames' own size out.

    Parameters
    ----------
    network : nn.Module
        Network in evaluation mode.
    preprocessing : Preprocessing
        Preprocessing that the network expects.
    batch_size : int
        Number of frames that pass at a time.
    threshold : float
        Probability from which a pixel is vessel, 0 to 1.
    device : str
        ``cpu`` or ``cuda``.
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
        """Load a network from a checkpoint file.

        Parameters
        ----------
        path : str or Path
            Checkpoint.
        batch_size : int
            Number of frames that pass at a time.
        device : str
            ``cpu`` or ``cuda``.

        Returns
        -------
        Predictor
            The network in use.

        Raises
        ------
        InputError
            If the file is no checkpoint of a known network.
        """
        checkpoint = Checkpoint.load(path)
        network = checkpoint.network().to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        return cls(network, checkpoint.preprocessing, batch_size=batch_size, device=device)

    def __call__(self, frames: UInt8[np.ndarray, "n h w *rgb"]) -> Bool[np.ndarray, "n h w"]:
        """Segment frames.

        Parameters
        ----------
        frames : ndarray of uint8, shape (n, h, w) or (n, h, w, 3)
            Grey or RGB frames of one size.

        Returns
        -------
        ndarray of bool, shape (n, h, w)
            Masks of the frames.

        Raises
        ------
        InputError
            If the frames have another shape or type.
        """
        masks = np.empty(_checked(frames).shape[:3], dtype=bool)
        for part, probability, _ in self._batches(frames):
            masks[part] = probability >= self.threshold
        return masks

    def probability(self, frames: UInt8[np.ndarray, "n h w *rgb"]) -> Float32[np.ndarray, "n h w"]:
        """Compute the probability of vessel in each pixel of each frame.

        Parameters
        ----------
        frames : ndarray of uint8, shape (n, h, w) or (n, h, w, 3)
            Grey or RGB frames of one size.

        Returns
        -------
        ndarray of float32, shape (n, h, w)
            Probabilities, 0 to 1.

        Raises
        ------
        InputError
            If the frames have another shape or type.
        """
        probabilities = np.empty(_checked(frames).shape[:3], dtype=np.float32)
        for part, probability, _ in self._batches(frames):
            probabilities[part] = probability
        return probabilities

    def timed(self, frames: UInt8[np.ndarray, "n h w *rgb"]) -> Prediction:
        """Segment frames and time each stage; on a GPU each stage waits for the one before.

        Parameters
        ----------
        frames : ndarray of uint8, shape (n, h, w) or (n, h, w, 3)
            Grey or RGB frames of one size.

        Returns
        -------
        Prediction
            Masks, probabilities and seconds.

        Raises
        ------
        InputError
            If the frames have another shape or type.
        """
        probabilities = np.empty(_checked(frames).shape[:3], dtype=np.float32)
        times = StageTimes()
        for part, probability, batch in self._batches(frames, wait=True):
            probabilities[part] = probability
            times += batch
        begin_s = time.perf_counter()
        masks = probabilities >= self.threshold
        return Prediction(
            masks, probabilities, times + StageTimes(restoration_s=time.perf_counter() - begin_s)
        )

    def _batches(
        self, frames: np.ndarray, wait: bool = False
    ) -> Iterator[tuple[slice, np.ndarray, StageTimes]]:
        """Which frames, their probabilities, and the times of this batch."""
        placement = self.preprocessing.placement(*frames.shape[1:3])
        self.network.eval()
        for first in range(0, len(frames), self.batch_size):
            part = slice(first, first + self.batch_size)
            begin_s = time.perf_counter()
            with torch.inference_mode():
                squares = self._prepared(frames[part])
                prepared_s = self._clock(wait)
                logits = self.network(squares)
                network_s = self._clock(wait)
                maps = self.preprocessing.restore(torch.sigmoid(logits.float()), placement).cpu().numpy()
            end_s = time.perf_counter()
            yield (
                part,
                maps,
                StageTimes(len(maps), prepared_s - begin_s, network_s - prepared_s, end_s - network_s),
            )

    def _prepared(self, frames: np.ndarray) -> Tensor:
        """The network's input: the stage that a training data set goes through, image by image."""
        grey = frames if frames.ndim == 3 else np.stack([echo_grey(frame) for frame in frames])
        # Cleaned before they go to the device: it works on arrays.
        # Turned or flipped frames are views with negative strides, which torch does not take; of a batch of one, numpy
        # calls even such a view contiguous.
        clean = np.array(self.preprocessing.clean(grey), order="C")
        images = torch.tensor(clean, device=self.device)
        squares = self.preprocessing.normalise(self.preprocessing.resize(images))
        return squares.contiguous(memory_format=torch.channels_last)

    def _clock(self, wait: bool) -> float:
        if wait and self.device != "cpu":
            torch.cuda.synchronize(self.device)
        return time.perf_counter()


def _checked(frames: np.ndarray) -> np.ndarray:
    if not isinstance(frames, np.ndarray):
        raise InputError(f"frames: expected a numpy array, received a {type(frames).__name__}")
    # Three or four columns are the channels of one colour frame that was not put in a stack.
    is_grey = frames.ndim == 3 and frames.shape[2] not in CHANNELS
    is_colour = frames.ndim == 4 and frames.shape[3] in CHANNELS
    if frames.dtype != np.uint8 or not (is_grey or is_colour) or 0 in frames.shape[1:]:
        raise InputError(
            "frames: expected uint8 of shape (n, height, width) or (n, height, width, 3), "
            f"received {frames.dtype} {frames.shape}"
        )
    return frames
