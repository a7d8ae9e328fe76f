"""What a prediction gives: masks and probabilities, and where the time went."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import cached_property
from html import escape

import numpy as np

from models.array_types import Bool, Float32
from models.pictures import frames_picture
from models.postprocessing.options import Option
from models.postprocessing.soft_mask import soft_mask


@dataclass(frozen=True)
class StageTimes:
    """Seconds that each stage of a prediction took; those of several calls add up.

    Parameters
    ----------
    frames : int
        Number of frames.
    preprocessing_s : float
        From the frames as recorded to the networks' input.
    network_s : float
        The networks alone, with the mean of their probabilities.
    restoration_s : float
        From their output to probabilities at the frames' own size.
    calibration_s : float
        Calibration of the probabilities.
    postprocessing_s : float
        From probabilities to masks.
    """

    frames: int = 0
    preprocessing_s: float = 0.0
    network_s: float = 0.0
    restoration_s: float = 0.0
    calibration_s: float = 0.0
    postprocessing_s: float = 0.0

    @property
    def total_s(self) -> float:
        """Seconds of all stages together."""
        return float(sum(astuple(self)[1:]))

    def __add__(self, other: StageTimes) -> StageTimes:
        return StageTimes(
            *(one + another for one, another in zip(astuple(self), astuple(other), strict=True))
        )

    def share(self, frames: int) -> StageTimes:
        """Compute the share of one of several frames that were computed together.

        Parameters
        ----------
        frames : int
            Number of frames.

        Returns
        -------
        StageTimes
            Of one frame.
        """
        return StageTimes(1, *(seconds / frames for seconds in astuple(self)[1:]))


@dataclass(frozen=True, eq=False)
class FramePrediction:
    """Result for one frame.

    Parameters
    ----------
    mask : ndarray of bool, shape (h, w)
        Mask of the vessel.
    probability : ndarray of float32, shape (h, w)
        Calibrated probability of vessel, 0 to 1.
    presence : float or None
        Probability that the frame shows a vessel; None where no network has that output.
    times : StageTimes
        Seconds of each stage; those of a batch are shared equally by its frames.
    option : Option
        From probability to mask.
    """

    mask: Bool[np.ndarray, "h w"]
    probability: Float32[np.ndarray, "h w"]
    presence: float | None
    times: StageTimes
    option: Option

    def __repr__(self) -> str:
        """One line: size, area and confidence, no pixels."""
        size = " x ".join(map(str, self.mask.shape))
        seen = "" if self.presence is None else f", presence={self.presence:.3f}"
        return f"FramePrediction({size} px, area_px={self.area_px}, confidence={self.confidence:.3f}{seen})"

    def _repr_html_(self) -> str:
        return f"{escape(repr(self))}{frames_picture([self.probability], [self.mask], ['probability'])}"

    @property
    def area_px(self) -> int:
        """Number of pixels of vessel."""
        return int(np.count_nonzero(self.mask))

    @property
    def confidence(self) -> float:
        """Mean over the mask's pixels of the probability; of an empty mask, one minus the highest probability."""
        if not self.mask.any():
            return 1.0 - float(self.probability.max())
        return float(self.probability[self.mask].mean(dtype=np.float64))

    @cached_property
    def soft_mask(self) -> Float32[np.ndarray, "h w"]:
        """Values of 0 to 1 whose level of one half is the outline of the mask (``postprocessing.soft_mask``)."""
        return soft_mask(self.probability, self.mask, self.option)


@dataclass(frozen=True)
class Prediction:
    """Result of a timed prediction.

    Parameters
    ----------
    masks : ndarray of bool, shape (n, h, w)
        Masks of the frames.
    probability : ndarray of float32, shape (n, h, w)
        Calibrated probability of vessel, 0 to 1.
    times : StageTimes
        Seconds of each stage.
    frames : ndarray of uint8, shape (n, h, w) or (n, h, w, 3), or None, optional
        The frames themselves, which a notebook shows with the masks; None shows the probability under them.
    """

    masks: Bool[np.ndarray, "n h w"]
    probability: Float32[np.ndarray, "n h w"]
    times: StageTimes
    frames: np.ndarray | None = None

    def __repr__(self) -> str:
        """One line: how many frames of what size, how many show a vessel, how long it took."""
        size = " x ".join(map(str, self.masks.shape[1:]))
        shown = int(self.masks.any(axis=(1, 2)).sum())
        return f"Prediction({len(self.masks)} frames of {size} px, {shown} with a vessel, {self.times.total_s:.2f} s)"

    def _repr_html_(self) -> str:
        under = self.probability if self.frames is None else self.frames
        return f"{escape(repr(self))}{frames_picture(under, self.masks) if len(self.masks) else ''}"
