"""A trained network applied to labelled frames: each case's mask, and the table of scores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import nn

from models.array_types import Bool, Float32
from models.labelled_frames import LabelledFrames
from models.metrics.scoring import columns_for, score_case
from models.predictor import Frame, Predictor
from models.preprocessing.preprocessing import Placement, Preprocessing


def predict(predictor: Predictor, frames: LabelledFrames) -> Iterator[tuple[str, np.ndarray]]:
    """Segment labelled frames case by case.

    Parameters
    ----------
    predictor : Predictor
        Trained network.
    frames : LabelledFrames
        Cases to segment.

    Yields
    ------
    case_id : str
        Id of the case.
    mask : ndarray of bool, shape (h, w)
        Mask of the case's own size.
    """
    given = map(Frame, frames.images, frames.spacing_mm)
    for case, found in zip(frames.case_ids, predictor.stream(given), strict=True):
        yield case, found.mask


@dataclass(frozen=True)
class CasePrediction:
    """Output of a network for one case.

    Parameters
    ----------
    case_id : str
        Id of the case.
    logits : ndarray of float32, shape (s, s)
        Logits in the network's square.
    placement : Placement
        Where the frame lies in it.
    mask : ndarray of bool, shape (h, w)
        Where the probability, brought to the frame's own size, is at least 0.5.
    """

    case_id: str
    logits: Float32[np.ndarray, "s s"]
    placement: Placement
    mask: Bool[np.ndarray, "h w"]


def predict_logits(
    network: nn.Module,
    preprocessing: Preprocessing,
    frames: LabelledFrames,
    batch_size: int = 8,
    device: str = "cpu",
) -> Iterator[CasePrediction]:
    """Compute logits and masks case by case, in the memory of one batch; cases of one size share batches.

    Parameters
    ----------
    network : nn.Module
        Trained network.
    preprocessing : Preprocessing
        Preprocessing that the network expects.
    frames : LabelledFrames
        Cases to predict.
    batch_size : int, optional
        Number of frames that pass at a time.
    device : str, optional
        ``cpu`` or ``cuda``.

    Yields
    ------
    CasePrediction
        Prediction of one case; its mask is that of ``Predictor``.
    """
    network = network.to(device, memory_format=torch.channels_last).eval()  # type: ignore[call-overload]
    for batch in _batches(frames, batch_size):
        images = [np.array(frames.images[index], order="C") for index in batch]
        placement = preprocessing.placement(*images[0].shape)
        with torch.inference_mode():
            squares = preprocessing.normalise(preprocessing(torch.tensor(np.stack(images), device=device)))
            logits = network(squares.contiguous(memory_format=torch.channels_last)).float()
            masks = (preprocessing.restore(torch.sigmoid(logits), placement) >= 0.5).cpu().numpy()
        for index, own, mask in zip(batch, logits[:, 0].cpu().numpy(), masks, strict=True):
            yield CasePrediction(frames.case_ids[index], own, placement, mask)


def _batches(frames: LabelledFrames, batch_size: int) -> Iterator[list[int]]:
    """Places of consecutive cases of one size."""
    by_size: dict[tuple[int, ...], list[int]] = {}
    for index, image in enumerate(frames.images):
        by_size.setdefault(image.shape, []).append(index)
    for indices in by_size.values():
        for first in range(0, len(indices), batch_size):
            yield indices[first : first + batch_size]


def score_cases(
    frames: LabelledFrames, predictions: Mapping[str, np.ndarray], about: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Score the predicted mask of every case.

    Parameters
    ----------
    frames : LabelledFrames
        Cases with their reference masks.
    predictions : mapping of str to ndarray
        Masks by case id.
    about : mapping
        Columns that are the same in all rows.

    Returns
    -------
    list of dict
        One row for each case: its id and group, ``about``, whether it is simulated, and its scores.
    """
    return [case_row(frames, index, predictions[case], about) for index, case in enumerate(frames.case_ids)]


def case_row(
    frames: LabelledFrames, index: int, prediction: Bool[np.ndarray, "h w"], about: Mapping[str, Any]
) -> dict[str, Any]:
    """Score the predicted mask of one case.

    Parameters
    ----------
    frames : LabelledFrames
        Cases with their reference masks.
    index : int
        Place of the case among them.
    prediction : ndarray of bool, shape (h, w)
        Mask of the case.
    about : mapping
        Columns that are the same in all rows.

    Returns
    -------
    dict
        The case's row of ``score_cases``.
    """
    score = score_case(prediction, frames.masks[index], frames.spacing_mm[index])
    scores = {column: getattr(score, column) for column in columns_for(frames.spacing_mm)}
    known = {"case_id": frames.case_ids[index], "group": frames.groups[index], **about}
    return {**known, "simulated": frames.simulated, **scores}
