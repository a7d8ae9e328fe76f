"""Registration of cases with a known deformation, rigid and deformable: a row a case, tables, and what they say."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.registration.benchmark.deformed import NO_START_MM, PARTS, paired_errors
from experiments.statistics import Interval, wilson_interval
from registration import transforms
from registration.benchmark.known_cases import KnownCase, KnownSpec, build_known
from registration.benchmark.known_deformations import NONE
from registration.benchmark.known_vessels import known_vessel
from registration.benchmark.scoring import material_error_mm, score_pose
from registration.cpd import CoherentPointDrift
from registration.deformable.displacement_field import gradient
from registration.deformable.result import RIGID_STANDS
from registration.errors import InputError as RegistrationInputError
from registration.metrics.surface_distance import rms
from registration.rigid import MultiStartICP
from registration.rigid.result import ACCEPTED

if TYPE_CHECKING:
    import pandas as pd

    from registration.deformable.result import DeformableResult

LEVEL = 0.9
REFUSED = "refused"
# What is asked for: the error where it was swept at least halved, and so many of the 90 % intervals that hold.
HALVED, HOLD_LOW, HOLD_HIGH = 0.5, 0.85, 0.95
SEEN = ("covered", "uncovered")


def known_rows(specs: Iterable[KnownSpec], aorta: Path | None) -> Iterator[dict[str, Any]]:
    """Make and register cases with the default methods, whose settings are frozen.

    The rigid pose is the multi-start's from a random pose; then the model is displaced.

    Parameters
    ----------
    specs : iterable of KnownSpec
        Cases, those of one vessel together.
    aorta : Path or None
        Folder of the aorta's files.

    Yields
    ------
    dict
        Values by column name; errors in mm. Infinite errors without a result.
    """
    vessel = None
    for spec in specs:
        if vessel is None or vessel.name != spec.vessel:
            vessel = known_vessel(spec.vessel, aorta)
        yield known_row(spec, build_known(spec, vessel))


def known_row(spec: KnownSpec, case: KnownCase) -> dict[str, Any]:
    """Register one case and measure the errors.

    Parameters
    ----------
    spec : KnownSpec
        Its specification.
    case : KnownCase
        The case.

    Returns
    -------
    dict
        Values by column name; where clouds are refused as not registered, the errors after it are infinite.
    """
    truth = case.truth
    begun = time.perf_counter()
    rigid = MultiStartICP()(case.moving_mm, case.fixed_mm)
    rigid_s = time.perf_counter() - begun
    pose, score = rigid.fixed_T_moving, score_pose(rigid.fixed_T_moving, truth)
    row: dict[str, Any] = {
        "case": truth.name,
        "anatomy": spec.vessel,
        "deformation": spec.deformation,
        "size_mm": spec.size_mm,
        "coverage": spec.coverage,
        "largest_mm": case.largest_mm,
        "same_vessel": True,
        "tre_rigid_mm": score.tre_rigid_mm,
        **{PARTS[part][0]: getattr(score, PARTS[part][0]) for part in PARTS},
        **{PARTS[part][1]: np.inf for part in PARTS},
        "rigid_verdict": rigid.verdict,
        "verdict": REFUSED,
        "rigid_s": rigid_s,
    }
    begun = time.perf_counter()
    try:
        found = CoherentPointDrift()(case.fixed_mm, transforms.apply(pose, case.moving_mm))
    except RegistrationInputError:
        return row
    row["deformable_s"] = time.perf_counter() - begun
    errors_mm = material_error_mm(pose, truth, found.displacement(truth.targets_mm))
    moved = np.eye(3) + gradient(found.displacement, truth.targets_mm)
    row |= {
        PARTS["all"][1]: rms(errors_mm),
        "verdict": found.verdict,
        "jacobian_min": min(found.plausibility.jacobian_min, float(np.linalg.det(moved).min())),
    }
    for part, chosen in zip(SEEN, (truth.covered, ~truth.covered), strict=True):
        row |= _part(part, found, truth.targets_mm[chosen], errors_mm[chosen])
    return row


def _part(
    part: str, found: DeformableResult, targets_mm: np.ndarray, errors_mm: np.ndarray
) -> dict[str, float]:
    """Error of some targets, whether the interval of their root mean square holds it, and how many of their own do."""
    if not len(targets_mm):
        return {PARTS[part][1]: np.nan}
    error_mm = rms(errors_mm)
    low_mm, high_mm = found.tre_interval_mm(targets_mm, LEVEL)
    row = {PARTS[part][1]: error_mm}
    if found.predicted is not None and np.isfinite(high_mm):
        row[f"holds_{part}"] = float(low_mm <= error_mm <= high_mm)
        drawn_mm = np.linalg.norm(found.predicted.draw_mm(targets_mm), axis=2)
        lows_mm, highs_mm = np.quantile(drawn_mm, [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
        row[f"targets_hold_{part}"] = float(((lows_mm <= errors_mm) & (errors_mm <= highs_mm)).mean())
    return row


def has_start(cases: pd.DataFrame) -> pd.Series:
    """Mark the cases whose rigid pose is a start for a displacement.

    A rigid pose follows the stretch that was swept, and differs from the rigid part of the whole by about as much as
    the wall is displaced; what is off by ``NO_START_MM`` more is another place.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows that ``known_rows`` gives.

    Returns
    -------
    pandas.Series
        Truth values by row.
    """
    return cases["tre_rigid_mm"] <= NO_START_MM + cases["largest_mm"]


def known_tables(cases: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Tabulate errors and predictions by deformation and coverage.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows that ``known_rows`` gives.

    Returns
    -------
    dict
        Two tables by title, a row for each deformation and coverage, then of each deformation and of all that deform.
    """
    import pandas as pd

    groups = list(_groups(cases))
    return {
        "errors, simulated": pd.DataFrame([place | _errors(own) for place, own in groups]),
        "predictions and verdicts, simulated": pd.DataFrame(
            [place | _predictions(own) for place, own in groups]
        ),
    }


def describe_known(cases: pd.DataFrame) -> tuple[str, ...]:
    """Say of each thing that is asked for whether it came out.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows that ``known_rows`` gives.

    Returns
    -------
    tuple of str
        Sentences.
    """
    deforming = cases[cases["deformation"] != NONE]
    own, still = deforming[has_start(deforming)], cases[(cases["deformation"] == NONE) & has_start(cases)]
    left_out = deforming[~has_start(deforming)]
    said = [
        f"{len(deforming)} cases that deform, of {deforming['anatomy'].nunique()} anatomies; {len(left_out)} without a "
        f"start, left out below: their rigid pose is off by {NO_START_MM:g} mm more than the wall is displaced (it was "
        f"accepted in {int((left_out['rigid_verdict'] == ACCEPTED).sum())} of them)."
    ]
    for part, most in zip(SEEN, (HALVED, 1.0), strict=True):
        pair = paired_errors(own, *PARTS[part])
        if pair is not None:
            said.append(
                f"{part.capitalize()}: rigid {pair.before_mm:.2f} mm, deformed {pair.after_mm:.2f} mm, ratio "
                f"{_ratio(pair.ratio)}, better in {pair.better} of {pair.cases} cases, worse in {pair.worse}. Asked "
                f"for: at most {most:g}; "
                f"{_met(pair.ratio, most)}."
            )
    said += _of_flat_limit(deforming)
    if len(own):
        folds = int((own["jacobian_min"] <= 0).sum())
        said.append(
            f"{folds} of {len(own)} fields fold. Asked for: none; {'met' if not folds else 'not met'}."
        )
    for part in SEEN:
        held = own[f"holds_{part}"].dropna() if f"holds_{part}" in own else own.iloc[:0, 0]
        if len(held):
            said.append(_of_intervals(part, held, float(own[f"targets_hold_{part}"].mean())))
    if len(still):
        held = still["holds_covered"].dropna()
        stands = int((still["verdict"] == RIGID_STANDS).sum())
        pair = paired_errors(still, *PARTS["all"])
        assert pair is not None
        said.append(
            f"Where nothing deforms, the rigid pose stands in {stands} of {len(still)} cases; mean error "
            f"{pair.before_mm:.3f} mm before, {pair.after_mm:.3f} mm after; {int(held.sum())} of {len(held)} intervals "
            "of what was swept hold it."
        )
    return tuple(said)


def _of_flat_limit(deforming: pd.DataFrame) -> list[str]:
    """What comes out where every pose that is off by more than ``NO_START_MM`` is left out, as of other benchmarks."""
    near = deforming[deforming["tre_rigid_mm"] <= NO_START_MM]
    pair = paired_errors(near, *PARTS["covered"])
    if pair is None:
        return []
    return [
        f"Left out at {NO_START_MM:g} mm flat ({len(deforming) - len(near)} cases, the largest bends among them) "
        f"covered errors are {pair.before_mm:.2f} and {pair.after_mm:.2f} mm, ratio {_ratio(pair.ratio)}: how "
        "much is gained depends on which starts count."
    ]


def _of_intervals(part: str, held: pd.Series, targets_hold: float) -> str:
    share = wilson_interval(int(held.sum()), len(held))
    verdict = "met" if HOLD_LOW <= share.rate <= HOLD_HIGH else "not met"
    if verdict == "not met" and share.low <= HOLD_HIGH and share.high >= HOLD_LOW:
        verdict = "not met, though so many cases leave it open"
    return (
        f"90 % intervals, {part}: {share.successes} of {share.trials} hold the error ({100 * share.rate:.0f} %, Wilson "
        f"95 % interval {100 * share.low:.0f} to {100 * share.high:.0f}); of the single targets "
        f"{100 * targets_hold:.0f} %. Asked for: {100 * HOLD_LOW:g} to {100 * HOLD_HIGH:g} %; {verdict}."
    )


def _groups(cases: pd.DataFrame) -> Iterator[tuple[dict[str, Any], pd.DataFrame]]:
    for deformation in cases["deformation"].drop_duplicates():
        own = cases[cases["deformation"] == deformation]
        for coverage in sorted(own["coverage"].unique()):
            place = {"deformation": deformation, "coverage": f"{100 * coverage:.0f} %"}
            yield place, own[own["coverage"] == coverage]
        yield {"deformation": deformation, "coverage": "all"}, own
    deforming = cases[cases["deformation"] != NONE]
    if len(deforming):
        yield {"deformation": "all that deform", "coverage": "all"}, deforming


def _errors(cases: pd.DataFrame) -> dict[str, Any]:
    own = cases[has_start(cases)]
    row: dict[str, Any] = {"cases": len(cases), "no_start": len(cases) - len(own)}
    for part in SEEN:
        pair = paired_errors(own, *PARTS[part])
        row |= {
            f"{part}_rigid_mm": np.nan if pair is None else pair.before_mm,
            f"{part}_deformed_mm": np.nan if pair is None else pair.after_mm,
            f"{part}_ratio": "" if pair is None else _ratio(pair.ratio),
            f"{part}_better": "" if pair is None else f"{pair.better}/{pair.cases}",
            f"{part}_worse": "" if pair is None else f"{pair.worse}/{pair.cases}",
        }
    return row


def _predictions(cases: pd.DataFrame) -> dict[str, Any]:
    own = cases[has_start(cases)]
    row: dict[str, Any] = {
        "cases": len(own),
        "rigid_stands": int((own["verdict"] == RIGID_STANDS).sum()),
        "folding": int((own["jacobian_min"] <= 0).sum()),
    }
    for part in SEEN:
        held = own[f"holds_{part}"].dropna() if f"holds_{part}" in own else own.iloc[:0, 0]
        row[f"{part}_hold"] = ""
        if len(held):
            share = wilson_interval(int(held.sum()), len(held))
            row[f"{part}_hold"] = f"{share.successes}/{share.trials} ({share.low:.2f} to {share.high:.2f})"
        row[f"{part}_targets_hold"] = own[f"targets_hold_{part}"].mean() if len(held) else np.nan
    return row | {"rigid_s": own["rigid_s"].median(), "deformable_s": own["deformable_s"].median()}


def _ratio(ratio: Interval) -> str:
    if not np.isfinite(ratio.low):
        return f"{ratio.estimate:.2f}"
    return f"{ratio.estimate:.2f} ({ratio.low:.2f} to {ratio.high:.2f})"


def _met(ratio: Interval, most: float) -> str:
    if ratio.estimate > most:
        return "not met"
    return "met" if ratio.high <= most else "met by the estimate, not by the whole of an interval"
