"""A trained network applied to labelled frames: each case's mask, and the table of scores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from models.labelled_frames import LabelledFrames
from models.metrics.scoring import columns_for, score_case
from models.predictor import Frame, Predictor


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
    columns = columns_for(frames.spacing_mm)
    rows = []
    for case, group, mask, spacing_mm in zip(
        frames.case_ids, frames.groups, frames.masks, frames.spacing_mm, strict=True
    ):
        score = score_case(predictions[case], mask, spacing_mm)
        scores = {column: getattr(score, column) for column in columns}
        rows.append({"case_id": case, "group": group, **about, "simulated": frames.simulated, **scores})
    return rows
