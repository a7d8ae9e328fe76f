"""A trained network applied to labelled frames: each case's mask, and the table of scores."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from models.labelled_frames import LabelledFrames
from models.metrics.scoring import columns_for, score_case
from models.predictor import Predictor


def predict(predictor: Predictor, frames: LabelledFrames) -> Iterator[tuple[str, np.ndarray]]:
    """Segment labelled frames case by case; consecutive cases of one size share batches.

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
    by_size: dict[tuple[int, ...], list[int]] = {}
    for index, image in enumerate(frames.images):
        by_size.setdefault(image.shape, []).append(index)
    for indices in by_size.values():
        for first in range(0, len(indices), predictor.batch_size):
            batch = indices[first : first + predictor.batch_size]
            masks = predictor(np.stack([frames.images[index] for index in batch]))
            yield from ((frames.case_ids[index], mask) for index, mask in zip(batch, masks, strict=True))


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
