"""Temperature and bias fitted on selection groups, and what they do to probabilities of other groups."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from experiments.analysis.consolidation.predictions import IDENTITY, Prediction
from models.calibration import (
    CalibrationStatistics,
    PixelStatistics,
    TemperatureScaling,
    boundary_band,
    fit_temperature,
)
from models.errors import InputError

NONE, TEMPERATURE, TEMPERATURE_BIAS = "none", "temperature", "temperature_bias"
# Temperature and bias fitted in the band around the boundary alone: elsewhere most pixels are sure and right.
BOUNDARY = "boundary"
CALIBRATIONS = (NONE, TEMPERATURE, TEMPERATURE_BIAS, BOUNDARY)
N_BINS = 15


@dataclass(frozen=True)
class FittedCalibrations:
    """The calibrations of one candidate.

    Parameters
    ----------
    scalings : mapping of str to TemperatureScaling
        By name of the calibration; one that could not be fitted is the identity.
    refusals : mapping of str to str
        Why a calibration could not be fitted.
    """

    scalings: Mapping[str, TemperatureScaling]
    refusals: Mapping[str, str]


def fit_calibrations(prediction: Prediction, *, band_px: float) -> FittedCalibrations:
    """Fit every calibration to a candidate's own logits, at the network's size.

    Parameters
    ----------
    prediction : Prediction
        Logits of cases that the fit may look at.
    band_px : float
        Half width of the band around the boundary in px of the network's size.

    Returns
    -------
    FittedCalibrations
        The calibrations, and which were refused.
    """
    scalings, refusals = {NONE: IDENTITY}, {}
    for name in CALIBRATIONS[1:]:
        band = band_px if name == BOUNDARY else None
        try:
            fitted = fit_temperature(partial(_batches, prediction, band), with_bias=name != TEMPERATURE)
        except InputError as refusal:
            scalings[name], refusals[name] = IDENTITY, str(refusal)
        else:
            scalings[name] = fitted.scaling
    return FittedCalibrations(scalings, refusals)


def _batches(prediction: Prediction, band_px: float | None) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    for logits, mask, _ in prediction.windows():
        if band_px is None:
            yield logits, mask
        else:
            band = boundary_band(mask, band_px)
            yield logits[band], mask[band]


def calibration_rows(
    prediction: Prediction, scaling: TemperatureScaling, *, band_px: float
) -> list[dict[str, Any]]:
    """Tabulate reliability on every group, everywhere and in the band around the boundary, at the network's size.

    Parameters
    ----------
    prediction : Prediction
        Logits of the cases to judge by.
    scaling : TemperatureScaling
        Calibration.
    band_px : float
        Half width of the band in px of the network's size.

    Returns
    -------
    list of dict
        One row for each group, region and bin that has pixels: ``group``, ``region``, ``bin``, ``pixels``,
        ``probability_sum``, ``vessel_pixels``; the first bin of a group and region carries ``nll_sum`` and
        ``brier_sum`` of all its pixels. Rows of the group ``""`` carry ``ace`` over all groups.
    """
    by_group: dict[str, CalibrationStatistics] = {}
    for logits, mask, group in prediction.windows():
        one = CalibrationStatistics.of(scaling(logits), mask, band_px=band_px, n_bins=N_BINS)
        by_group[group] = by_group[group] + one if group in by_group else one
    rows: list[dict[str, Any]] = []
    for group, found in by_group.items():
        for region, statistics in (("everywhere", found.everywhere), ("boundary", found.boundary)):
            rows += [{"group": group, "region": region, **row} for row in _bins(statistics)]
    total = sum(list(by_group.values())[1:], start=next(iter(by_group.values())))
    for region, statistics in (("everywhere", total.everywhere), ("boundary", total.boundary)):
        rows.append({"group": "", "region": region, "ace": statistics.ace})
    return rows


def _bins(statistics: PixelStatistics) -> list[dict[str, Any]]:
    table = statistics.equal_width
    rows: list[dict[str, Any]] = [
        {
            "bin": int(place),
            "pixels": int(table.counts[place]),
            "probability_sum": float(table.probability_sums[place]),
            "vessel_pixels": int(table.vessel_counts[place]),
            "nll_sum": 0.0,
            "brier_sum": 0.0,
        }
        for place in np.flatnonzero(table.counts)
    ]
    if rows:
        rows[0] |= {"nll_sum": statistics.nll_sum, "brier_sum": statistics.brier_sum}
    return rows
