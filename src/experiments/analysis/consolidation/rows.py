"""Rows of a job's table: scores of cases, reliability, barriers and what each candidate costs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from experiments.analysis.consolidation.calibrations import FittedCalibrations, calibration_rows
from experiments.analysis.consolidation.candidates import BEST_FOLD, MEAN_FOLD, Candidate
from experiments.analysis.consolidation.predictions import Prediction
from experiments.analysis.consolidation.thresholds import RAW, Step
from experiments.statistics import by_unit
from models.averaging import PairwiseBarriers
from models.metrics.scoring import columns_for, score_case

if TYPE_CHECKING:
    import pandas as pd

SELECTION, TEST = "selection", "test"
CASE, RELIABILITY, BARRIER, CANDIDATE = "case", "reliability", "barrier", "candidate"
# Columns that stay where no row has a value: a part without an empty frame has no false alarms.
ALWAYS = ("dsc", "missed", "false_alarm")
# Number of the fold in rows of candidates that are made of all folds.
NO_FOLD = -1


def case_rows(
    prediction: Prediction, steps: Iterable[Step], *, part: str, model: str, fold: int = NO_FOLD
) -> list[dict[str, Any]]:
    """Score every case of a candidate at native size, at one or several steps from logits to masks.

    Parameters
    ----------
    prediction : Prediction
        Logits of the candidate.
    steps : iterable of Step
        Ways from logits to masks.
    part : str
        ``selection`` or ``test``.
    model : str
        Name of the candidate.
    fold : int, optional
        Number of the fold; ``NO_FOLD`` for a candidate of all folds.

    Returns
    -------
    list of dict
        One row for each case and step.
    """
    frames, rows = prediction.cases.frames, []
    columns = columns_for(frames.spacing_mm)
    chosen = tuple(steps)
    for index, (case, group, reference, spacing) in enumerate(
        zip(frames.case_ids, frames.groups, frames.masks, frames.spacing_mm, strict=True)
    ):
        # Steps share a calibration, and many of them a mask.
        maps = {step.calibration: prediction.native(index, step.calibration) for step in chosen}
        scored: dict[bytes, Any] = {}
        for step in chosen:
            mask = step.option(maps[step.calibration], spacing)
            key = mask.tobytes()
            if key not in scored:
                scored[key] = score_case(mask, reference, spacing)
            scores = {column: getattr(scored[key], column) for column in columns}
            about = {"model": model, "fold": fold, "part": part, "step": step.name}
            rows.append({"kind": CASE, **about, "group": group, "case_id": case, **scores})
    return rows


def best_fold_rows(rows: Iterable[Mapping[str, Any]]) -> tuple[int, list[dict[str, Any]]]:
    """Choose the fold whose network is best on selection groups, and name its rows.

    Parameters
    ----------
    rows : iterable of mapping
        Rows of all folds (``mean fold``) on selection cases.

    Returns
    -------
    fold : int
        Number of the best fold, by mean DSC over groups; of equal ones the first.
    rows : list of dict
        Its rows as those of ``best fold``.
    """
    import pandas as pd

    given = [row for row in rows if row["model"] == MEAN_FOLD and row["part"] == SELECTION]
    table = pd.DataFrame(given)
    means = {int(str(fold)): float(by_unit(part, "dsc").mean()) for fold, part in table.groupby("fold")}
    best = max(means, key=lambda fold: (means[fold], -fold))
    return best, as_best_fold(given, best)


def as_best_fold(rows: Iterable[Mapping[str, Any]], fold: int) -> list[dict[str, Any]]:
    """Copy the rows of one fold as those of the best fold.

    Parameters
    ----------
    rows : iterable of mapping
        Rows of all folds.
    fold : int
        Number of the best fold.

    Returns
    -------
    list of dict
        The copies.
    """
    return [
        {**row, "model": BEST_FOLD, "fold": NO_FOLD}
        for row in rows
        if row["model"] == MEAN_FOLD and row["fold"] == fold
    ]


def reliability_rows(
    prediction: Prediction, fitted: FittedCalibrations, *, band_px: float, model: str, fold: int = NO_FOLD
) -> list[dict[str, Any]]:
    """Tabulate the reliability of a candidate under every calibration.

    Parameters
    ----------
    prediction : Prediction
        Logits of the test cases.
    fitted : FittedCalibrations
        Its calibrations.
    band_px : float
        Half width of the band around the boundary in px.
    model : str
        Name of the candidate.
    fold : int, optional
        Number of the fold.

    Returns
    -------
    list of dict
        Rows as ``calibration_rows`` gives them, with the calibration's name, temperature and bias.
    """
    rows = []
    for name, scaling in fitted.scalings.items():
        about = {"kind": RELIABILITY, "model": model, "fold": fold, "calibration": name}
        values = {"temperature": scaling.temperature, "bias": scaling.bias}
        found = calibration_rows(prediction, scaling, band_px=band_px)
        rows += [{**about, **row, **(values if row["group"] == "" else {})} for row in found]
    return rows


def barrier_rows(barriers: PairwiseBarriers) -> list[dict[str, Any]]:
    """Tabulate loss and DSC along the lines between networks.

    Parameters
    ----------
    barriers : PairwiseBarriers
        The lines.

    Returns
    -------
    list of dict
        One row for each point of each line.
    """
    return [
        {
            "kind": BARRIER,
            "first": path.first,
            "second": path.second,
            "alpha": float(alpha),
            "loss": float(loss),
            "dsc": float(dsc),
        }
        for path in barriers.paths
        for alpha, loss, dsc in zip(path.alphas, path.losses, path.dscs, strict=True)
    ]


def candidate_row(candidate: Candidate, model: str, seconds_per_frame: float, **about: Any) -> dict[str, Any]:
    """Tabulate what a candidate costs.

    Parameters
    ----------
    candidate : Candidate
        The candidate.
    model : str
        Its name in tables.
    seconds_per_frame : float
        Time of preprocessing and networks.
    **about : Any
        Further columns.

    Returns
    -------
    dict
        The row.
    """
    return {
        "kind": CANDIDATE,
        "model": model,
        "fold": NO_FOLD,
        "networks": len(candidate.members),
        "megabytes": candidate.megabytes,
        "seconds_per_frame": seconds_per_frame,
        **about,
    }


def of_kind(cases: pd.DataFrame, kind: str, **columns: str) -> pd.DataFrame:
    """Select the rows of one kind.

    Parameters
    ----------
    cases : pandas.DataFrame
        Table of one or several jobs.
    kind : str
        Kind of the rows.
    **columns : str
        Values of further columns.

    Returns
    -------
    pandas.DataFrame
        The rows, without columns that none of them has a value in.
    """
    chosen = cases["kind"] == kind
    for name, value in columns.items():
        chosen &= cases[name] == value
    kept = cases[chosen]
    return kept[[column for column in kept if column in ALWAYS or kept[column].notna().any()]]


def raw_cases(cases: pd.DataFrame, part: str) -> pd.DataFrame:
    """Select the scores at a threshold of 0.5 without calibration.

    Parameters
    ----------
    cases : pandas.DataFrame
        Table of one or several jobs.
    part : str
        ``selection`` or ``test``.

    Returns
    -------
    pandas.DataFrame
        One row for each case and candidate of each job.
    """
    return of_kind(cases, CASE, part=part, step=RAW)
