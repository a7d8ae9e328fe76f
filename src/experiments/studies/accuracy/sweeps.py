"""One simulated sweep of the accuracy study: its cloud, both stages of the registration, and a row for each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.registered_sweep import (
    RegisteredSweep,
    RegistrationStages,
    StageError,
)
from experiments.errors import InputError
from registration.errors import InputError as RegistrationInputError
from registration.pipeline import CloudFilter, gather
from registration.rigid.result import FAILED as RIGID_FAILED
from registration.synchronisation import synchronise

if TYPE_CHECKING:
    import pandas as pd

    from registration.metrics.surface_distance import SurfaceResiduals
    from registration.phantom.scan import SimulatedSweep
    from registration.reconstruction.contours import ContourExtractor
    from registration.reconstruction.mask_outliers import MaskOutliers

RIGID, DEFORMABLE = "rigid", "deformable"
RESIDUALS = ("rmse_mm", "rmse_trimmed_mm", "rmse_bidirectional_mm", "msd_mm", "hd95_mm", "coverage")
ERRORS = ("tre_mm", "tre_max_mm", "tre_covered_mm", "tre_uncovered_mm")
PARTS = ("", "_covered", "_uncovered")
# The column with the name of a stage's method.
METHOD = "method"
PLAUSIBILITY = ("strain_p95", "strain_max", "jacobian_min", "bending_energy_per_mm2")


@dataclass(frozen=True)
class CloudOfSweep:
    """How the cloud of a sweep is made.

    Parameters
    ----------
    contours : ContourExtractor
        Extraction of contours from the masks.
    filters : Mapping[str, CloudFilter]
        Filters of the point cloud by name, in order of use.
    mask_outliers : MaskOutliers
        Test that rejects masks that disagree with their neighbours.
    masks_of : callable
        Masks or probabilities of a simulated sweep's frames.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    share : float
        Share of the frames that is used, from the middle of the sweep.
    """

    contours: ContourExtractor
    filters: Mapping[str, CloudFilter]
    mask_outliers: MaskOutliers
    masks_of: Callable[[SimulatedSweep], np.ndarray]
    max_gap_s: float
    share: float


def rows_of(sweep: SimulatedSweep, clouds: CloudOfSweep, stages: RegistrationStages) -> list[dict[str, Any]]:
    """Register one sweep and measure what each stage leaves.

    Parameters
    ----------
    sweep : SimulatedSweep
        Simulated sweep and its truth.
    clouds : CloudOfSweep
        How its cloud is made.
    stages : RegistrationStages
        The stages of the registration.

    Returns
    -------
    list of dict
        A row for the rigid stage, and one for the deformable stage where one was asked for. What failed is infinitely
        far off, with the reason as ``error``.
    """
    asked = [RIGID] if None in stages.deformable.values() else [RIGID, DEFORMABLE]
    seconds: dict[str, float] = {}
    try:
        registered = _registered(sweep, clouds, stages, seconds)
    except (InputError, RegistrationInputError) as refused:
        return [_failed(stage, str(refused)) for stage in asked]
    if registered.result.verdict == RIGID_FAILED:
        return [_failed(stage, registered.result.reason) for stage in asked]
    rows = [
        {
            **_row(RIGID, registered.residuals, registered.error),
            "verdict": registered.result.verdict,
            "tre_rigid_mm": registered.pose.tre_mm,
            "runtime_s": seconds["registration_s"],
        }
    ]
    if len(asked) > 1:
        rows.append(_deformable_row(registered, seconds))
    return rows


def _registered(
    sweep: SimulatedSweep, clouds: CloudOfSweep, stages: RegistrationStages, seconds: dict[str, float]
) -> RegisteredSweep:
    posed = synchronise(sweep.sweep, clouds.max_gap_s)
    count = max(1, round(clouds.share * len(posed.kept)))
    first = (len(posed.kept) - count) // 2
    used = slice(first, first + count)
    gathered = gather(
        clouds.masks_of(sweep)[posed.kept[used]],
        posed.world_A_pixel[used],
        clouds.contours,
        clouds.filters,
        clouds.mask_outliers,
    )
    return stages(sweep, gathered.cloud, posed.kept[used], seconds)


def _deformable_row(registered: RegisteredSweep, seconds: Mapping[str, float]) -> dict[str, Any]:
    deformed, error = registered.deformed, registered.deformed_error
    if deformed is None or error is None:
        return _failed(DEFORMABLE, registered.refusal)
    if deformed.result.plausibility.folds:
        return _failed(DEFORMABLE, deformed.result.reason)
    return {
        **_row(DEFORMABLE, deformed.residuals, error),
        **{name: float(getattr(deformed.result.plausibility, name)) for name in PLAUSIBILITY},
        "verdict": deformed.result.verdict,
        "runtime_s": seconds["deformable_s"],
    }


def _row(stage: str, residuals: SurfaceResiduals, error: StageError) -> dict[str, Any]:
    row: dict[str, Any] = {"stage": stage, "error": ""}
    row |= {name: float(getattr(residuals, name)) for name in RESIDUALS}
    row |= {name: float(getattr(error, name)) for name in ERRORS}
    for part in PARTS:
        low_mm, high_mm = getattr(error, f"predicted{part}_mm")
        measured_mm = row[f"tre{part}_mm"]
        row |= {f"tre{part}_low_mm": low_mm, f"tre{part}_high_mm": high_mm}
        known = np.isfinite([measured_mm, high_mm]).all()
        row[f"holds{part}"] = float(low_mm <= measured_mm <= high_mm) if known else float("nan")
    return row


def _failed(stage: str, reason: str) -> dict[str, Any]:
    """The row of a stage that found nothing."""
    far = dict.fromkeys((*(name for name in RESIDUALS if name != "coverage"), *ERRORS), np.inf)
    return {"stage": stage, **far, "coverage": 0.0, "verdict": "failed", "error": reason}


def column_of(rows: pd.DataFrame, name: str) -> pd.Series:
    """Return a column that not all kinds of rows have.

    Parameters
    ----------
    rows : pandas.DataFrame
        Rows of sweeps and stages.
    name : str
        Name of the column.

    Returns
    -------
    pandas.Series
        The column; NaN where there is none.
    """
    return rows.reindex(columns=[name])[name].astype(float)
