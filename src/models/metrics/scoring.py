"""The scores of one case, and their summary over many, by the same rule for every model.

A case whose reference shows no vessel counts only as a false alarm or not; in every other case a missed vessel
scores 0 and the image's diagonal, so that every model is scored on the same cases.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from models.array_types import Shaped
from models.metrics import masks

NOT_DEFINED = float("nan")


@dataclass(frozen=True)
class CaseScore:
    """Scores of one mask; NaN where a score is not defined for the case.

    ``dsc``, ``hd95_mm`` and ``hd95_px`` are penalised: a missed vessel scores 0 and the image's diagonal.

    Parameters
    ----------
    dsc : float
        Dice similarity coefficient, 0 to 1.
    hd95_mm : float
        95th percentile of the Hausdorff distance in mm, where the spacing is known.
    hd95_px : float
        The same in px.
    hd95_surfel_mm : float
        Of contour elements weighted by length, where both masks show a vessel.
    hd95_unpenalised_mm : float
        As ``hd95_mm``, where both masks show a vessel.
    hd95_unpenalised_px : float
        As ``hd95_px``, where both masks show a vessel.
    missed : float
        1 if the vessel was missed and 0 if not, where the reference shows one.
    false_alarm : float
        1 if a vessel was found and 0 if not, where the reference shows none.
    """

    dsc: float = NOT_DEFINED
    hd95_mm: float = NOT_DEFINED
    hd95_px: float = NOT_DEFINED
    hd95_surfel_mm: float = NOT_DEFINED
    hd95_unpenalised_mm: float = NOT_DEFINED
    hd95_unpenalised_px: float = NOT_DEFINED
    missed: float = NOT_DEFINED
    false_alarm: float = NOT_DEFINED


def score_case(
    prediction: Shaped[np.ndarray, "h w"],
    reference: Shaped[np.ndarray, "h w"],
    spacing_mm: tuple[float, float] | None,
) -> CaseScore:
    """Score a mask at its own resolution.

    Parameters
    ----------
    prediction, reference : ndarray of bool or of 0 and 1, shape (h, w)
        Masks of one size.
    spacing_mm : tuple of float, or None
        Vertical and horizontal size of a pixel in mm; None where unknown.

    Returns
    -------
    CaseScore
        Scores of the case.
    """
    overlap = masks.dsc(prediction, reference)
    if not reference.any():
        return CaseScore(false_alarm=float(prediction.any()))
    if not prediction.any():
        return CaseScore(
            dsc=0.0,
            hd95_mm=NOT_DEFINED if spacing_mm is None else masks.diagonal(reference.shape, spacing_mm),
            hd95_px=masks.diagonal(reference.shape, 1.0),
            missed=1.0,
        )
    distance_px = masks.hd95_px(prediction, reference)
    if spacing_mm is None:
        return CaseScore(dsc=overlap, hd95_px=distance_px, hd95_unpenalised_px=distance_px, missed=0.0)
    distance_mm = masks.hd95_mm(prediction, reference, spacing_mm)
    return CaseScore(
        dsc=overlap,
        hd95_mm=distance_mm,
        hd95_px=distance_px,
        hd95_surfel_mm=masks.hd95_surfel_mm(prediction, reference, spacing_mm),
        hd95_unpenalised_mm=distance_mm,
        hd95_unpenalised_px=distance_px,
        missed=0.0,
    )


def columns_for(spacings_mm: Iterable[tuple[float, float] | None]) -> tuple[str, ...]:
    """Choose the scores that a table has columns for.

    Parameters
    ----------
    spacings_mm : iterable of tuple of float, or None
        Spacing of every case.

    Returns
    -------
    tuple of str
        Scores in mm where every case has a spacing, in px where none has, both if mixed.
    """
    known = {spacing is not None for spacing in spacings_mm}
    left_out = {frozenset({True}): "_px", frozenset({False}): "_mm"}.get(frozenset(known), "none")
    return tuple(name for name in CaseScore.__dataclass_fields__ if not name.endswith(left_out))


def summarise(scores: Mapping[str, Iterable[float]]) -> dict[str, float]:
    """Summarise scores over the cases where each is defined.

    ``missed`` and ``false_alarm`` are counts of a case: they become ``missed_rate`` and ``false_alarm_rate``.

    Parameters
    ----------
    scores : mapping of str to iterable of float
        Values of all cases by metric; NaN where not defined.

    Returns
    -------
    dict of str to float
        ``<metric>_mean``, ``_std`` (n - 1), ``_median``, ``_p95`` and ``_n``.

    Examples
    --------
    >>> summarise({"dsc": [0.5, 1.0, float("nan")]})["dsc_mean"]
    0.75
    """
    summary: dict[str, float] = {}
    for name, values in scores.items():
        defined = np.asarray(list(values), dtype=np.float64)
        defined = defined[~np.isnan(defined)]
        if name in ("missed", "false_alarm"):
            if len(defined):
                summary[f"{name}_rate"] = float(defined.mean())
                summary[f"{name}_n"] = float(len(defined))
            continue
        summary |= _five_numbers(name, defined)
    return summary


def _five_numbers(name: str, values: np.ndarray) -> dict[str, float]:
    if not len(values):
        return {f"{name}_n": 0.0}
    return {
        f"{name}_mean": float(values.mean()),
        f"{name}_std": float(values.std(ddof=1)) if len(values) > 1 else NOT_DEFINED,
        f"{name}_median": float(np.median(values)),
        f"{name}_p95": float(np.quantile(values, 0.95)),
        f"{name}_n": float(len(values)),
    }
