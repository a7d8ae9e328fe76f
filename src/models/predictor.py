"""Vessel masks from frames, by a trained model."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from models.calibration.temperature import TemperatureScaling, logits_of
from models.errors import InputError
from models.inference.engines import Forward, forward_of, require_engine
from models.inference.ensemble import MeanProbability
from models.inference.frames import Frame, batches_of, frames_of, is_one_frame
from models.inference.results import FramePrediction, Prediction, StageTimes
from models.model_file import SegmentationModel
from models.postprocessing.hysteresis import Hysteresis
from models.postprocessing.morphology import Morphology
from models.postprocessing.options import Option
from models.preprocessing.preprocessing import Preprocessing

__all__ = ["Frame", "FramePrediction", "Prediction", "Predictor", "StageTimes"]

# What a caller may hand over; anything else is refused with a sentence.
Frames = Any
HALF = Option(Hysteresis(), Morphology())


@dataclass(frozen=True)
class Predictor:
    """Trained model in use: frames in, masks or probabilities of the frames' own size out.

    The stages of a frame: preprocessing, the networks' mean probability, restoration to the frame's size, calibration,
    and thresholds with morphology.

    Parameters
    ----------
    networks : nn.Module or sequence of nn.Module
        Network, or several whose probabilities are averaged, on the device.
    preprocessing : Preprocessing
        Preprocessing that all of them expect.
    calibration : TemperatureScaling or None, optional
        Calibration of the logit of the probability.
    postprocessing : Option, optional
        From probability to mask; as it stands, a threshold of 0.5.
    min_presence : float or None, optional
        Frames whose probability of showing a vessel is below this have an empty mask; None for no such gate, and
        without effect for networks that have no such output.
    flips : bool, optional
        Whether probabilities are means over the frame and its mirror image.
    batch_size : int, optional
        Number of frames that pass at a time.
    device : str, optional
        ``cpu`` or ``cuda``.
    engine : str, optional
        What runs the networks; one of ``models.inference.engines.ENGINES``.

    Raises
    ------
    InputError
        If a setting is out of range.
    """

    networks: nn.Module | Sequence[nn.Module]
    preprocessing: Preprocessing
    calibration: TemperatureScaling | None = None
    postprocessing: Option = HALF
    min_presence: float | None = None
    flips: bool = False
    batch_size: int = 8
    device: str = "cpu"
    engine: str = "eager"

    def __post_init__(self) -> None:
        if self.batch_size < 1:
            raise InputError(f"batch_size: expected at least 1, received {self.batch_size}")
        if self.min_presence is not None and not 0 <= self.min_presence <= 1:
            raise InputError(f"min_presence: expected 0 to 1, received {self.min_presence}")
        require_engine(self.engine)

    def __repr__(self) -> str:
        """One screen: the networks by name, and the settings."""
        several = (self.networks,) if isinstance(self.networks, nn.Module) else tuple(self.networks)
        names = ", ".join(sorted({type(network).__name__ for network in several}))
        return (
            f"Predictor({len(several)} network{'s' * (len(several) > 1)} ({names}) on {self.device} by {self.engine},\n"
            f"    calibration={self.calibration},\n"
            f"    min_presence={self.min_presence}, flips={self.flips}, batch_size={self.batch_size})"
        )

    @classmethod
    def load(
        cls, path: str | Path, batch_size: int = 8, device: str = "cpu", engine: str = "eager"
    ) -> Predictor:
        """Load a model from a model file, or one network from the checkpoint of a fold.

        Parameters
        ----------
        path : str or Path
            File of a model.
        batch_size : int
            Number of frames that pass at a time.
        device : str
            ``cpu`` or ``cuda``.
        engine : str
            What runs the networks; other ones than ``eager`` take seconds to prepare.

        Returns
        -------
        Predictor
            The model in use.

        Raises
        ------
        InputError
            If the file is neither, or the engine is unknown.
        """
        return cls.from_model(SegmentationModel.load(path), batch_size, device, engine)

    @classmethod
    def from_model(
        cls, model: SegmentationModel, batch_size: int = 8, device: str = "cpu", engine: str = "eager"
    ) -> Predictor:
        """Put a model to use.

        Parameters
        ----------
        model : SegmentationModel
            The model.
        batch_size : int
            Number of frames that pass at a time.
        device : str
            ``cpu`` or ``cuda``.
        engine : str
            What runs the networks.

        Returns
        -------
        Predictor
            The model in use.
        """
        networks = tuple(
            member.network().to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
            for member in model.members
        )
        return cls(
            networks,
            model.preprocessing,
            model.calibration,
            HALF if model.postprocessing is None else model.postprocessing,
            model.min_presence,
            model.flips,
            batch_size,
            device,
            engine,
        )

    def __call__(self, frames: Frames, spacing_mm: tuple[float, float] | None = None) -> Any:
        """Segment frames.

        Parameters
        ----------
        frames : ndarray or sequence of ndarray of uint8
            One frame (h, w) or (h, w, 3), a stack (n, h, w) or (n, h, w, 3), or a sequence of frames of any sizes.
        spacing_mm : tuple of float or None, optional
            Vertical and horizontal size of their pixels in mm, for thresholds of area in mm^2; None where unknown.

        Returns
        -------
        ndarray of bool or list of ndarray
            The masks in the same form: (h, w), (n, h, w), or a list.

        Raises
        ------
        InputError
            If the frames have another shape or type, or a spacing is needed and unknown.
        """
        found = self.stream(frames_of(frames, spacing_mm))
        return _in_form_of(frames, (each.mask for each in found), np.bool_)

    def probability(self, frames: Frames) -> Any:
        """Compute the calibrated probability of vessel in each pixel of each frame.

        Parameters
        ----------
        frames : ndarray or sequence of ndarray of uint8
            As in a call.

        Returns
        -------
        ndarray of float32 or list of ndarray
            Probabilities, 0 to 1, in the same form.

        Raises
        ------
        InputError
            If the frames have another shape or type.
        """
        found = self._probabilities(iter(frames_of(frames, None)))
        return _in_form_of(frames, (probability for probability, *_ in found), np.float32)

    def soft_masks(self, frames: Frames, spacing_mm: tuple[float, float] | None = None) -> Any:
        """Compute maps whose level of one half is the outline of the masks, for outlines of sub-pixel accuracy.

        Parameters
        ----------
        frames : ndarray or sequence of ndarray of uint8
            As in a call.
        spacing_mm : tuple of float or None, optional
            As in a call.

        Returns
        -------
        ndarray of float32 or list of ndarray
            Values 0 to 1 in the same form: the probability itself for a plain threshold of one half.

        Raises
        ------
        InputError
            As in a call.
        """
        found = self.stream(frames_of(frames, spacing_mm))
        return _in_form_of(frames, (each.soft_mask for each in found), np.float32)

    def timed(self, frames: Frames) -> Prediction:
        """Segment a stack of frames and time each stage; on a GPU each stage waits for the one before.

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
        found = list(self.stream(frames_of(frames, None)))
        masks = _in_form_of(frames, (each.mask for each in found), np.bool_)
        maps = _in_form_of(frames, (each.probability for each in found), np.float32)
        times = sum((each.times for each in found), StageTimes())
        shown = frames if isinstance(frames, np.ndarray) and frames.ndim > 2 else None
        return Prediction(np.asarray(masks), np.asarray(maps), times, shown)

    def stream(self, frames: Iterable[Frame | np.ndarray]) -> Iterator[FramePrediction]:
        """Segment a stream of frames of any sizes; a batch of them is held at a time.

        Parameters
        ----------
        frames : iterable of Frame or ndarray
            Frames, which may be read as they are asked for.

        Yields
        ------
        FramePrediction
            Result for each frame, in order.

        Raises
        ------
        InputError
            If a frame has another shape or type, or its spacing is needed and unknown.
        """
        given = (frame if isinstance(frame, Frame) else Frame(frame) for frame in frames)
        for probability, presence, frame, times in self._probabilities(given):
            begin_s = time.perf_counter()
            mask = self._mask(probability, presence, frame)
            spent = StageTimes(postprocessing_s=time.perf_counter() - begin_s)
            yield FramePrediction(mask, probability, presence, times + spent, self.postprocessing)

    @cached_property
    def _forward(self) -> Forward:
        networks = (self.networks,) if isinstance(self.networks, nn.Module) else tuple(self.networks)
        ensemble = MeanProbability(networks, self.flips)
        return forward_of(ensemble, self.engine, self.preprocessing.image_size_px, self.device)

    def _probabilities(
        self, frames: Iterator[Frame]
    ) -> Iterator[tuple[np.ndarray, float | None, Frame, StageTimes]]:
        """Calibrated probability, that of presence, the frame and its share of the times, frame by frame."""
        for batch in batches_of(frames, self.batch_size):
            begin_s = time.perf_counter()
            with torch.inference_mode():
                squares = self._squares(batch)
                prepared_s = self._clock()
                outputs = self._forward(squares)
                network_s = self._clock()
                maps = self._restored(outputs[0], batch)
            presences = outputs[1].tolist() if len(outputs) > 1 else [None] * len(batch)
            restored_s = time.perf_counter()
            if self.calibration is not None:
                maps = [self.calibration(logits_of(each)) for each in maps]
            end_s = time.perf_counter()
            times = StageTimes(
                len(batch),
                prepared_s - begin_s,
                network_s - prepared_s,
                restored_s - network_s,
                end_s - restored_s,
            ).share(len(batch))
            yield from (
                (probability, presence, frame, times)
                for probability, presence, frame in zip(maps, presences, batch, strict=True)
            )

    def _squares(self, batch: Sequence[Frame]) -> Tensor:
        """The networks' input: the stage that a training data set goes through, frames of one size at a time."""
        parts = []
        for _, run in groupby(batch, key=lambda frame: frame.size):
            # Cleaned before they go to the device: it works on arrays. Rotated or flipped frames are views with
            # negative strides, which torch does not take; numpy calls even such a view of one frame contiguous.
            clean = np.array(self.preprocessing.clean(np.stack([frame.grey for frame in run])), order="C")
            images = torch.tensor(clean, device=self.device)
            parts.append(self.preprocessing.normalise(self.preprocessing.resize(images)))
        return torch.cat(parts).contiguous(memory_format=torch.channels_last)

    def _restored(self, maps: Tensor, batch: Sequence[Frame]) -> list[np.ndarray]:
        """Probabilities at the frames' own sizes."""
        restored: list[np.ndarray] = []
        for size, run in groupby(batch, key=lambda frame: frame.size):
            part = maps[len(restored) : len(restored) + len(list(run))].to(self.device)
            native = self.preprocessing.restore(part, self.preprocessing.placement(*size))
            restored.extend(native.clamp(0, 1).cpu().numpy())  # interpolation may leave the range by rounding
        return restored

    def _mask(self, probability: np.ndarray, presence: float | None, frame: Frame) -> np.ndarray:
        if presence is not None and self.min_presence is not None and presence < self.min_presence:
            return np.zeros(probability.shape, dtype=bool)
        return self.postprocessing(probability, frame.spacing_mm)

    def _clock(self) -> float:
        if self.device != "cpu":
            torch.cuda.synchronize(self.device)
        return time.perf_counter()


def _in_form_of(frames: Frames, maps: Iterable[np.ndarray], dtype: type) -> Any:
    """Maps as their frames were handed over: one, in one array, or as a list."""
    if not isinstance(frames, np.ndarray):
        return list(maps)
    if is_one_frame(frames):
        return next(iter(maps))
    # Filled as they come: a list of them and their stack would be twice the memory.
    stack = np.empty(frames.shape[:3], dtype=dtype)
    for place, found in enumerate(maps):
        stack[place] = found
    return stack
