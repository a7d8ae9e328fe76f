"""Anyone's masks scored against reference masks: a row of scores for each case, and what is reported of all."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.datasets.images.image_files import read_labels, read_mask
from experiments.errors import InputError
from experiments.outcome import Progress
from experiments.studies.evaluate.mask_pairs import MaskPairs

if TYPE_CHECKING:
    import pandas as pd

# Without a label, masks hold 0 and 1, or 0 and 255.
VESSEL, BACKGROUND = (1, 255), (0,)
ANY_LABEL = range(256)
COUNTS = ("cases", "cases_missing")
QUOTED = (
    *COUNTS,
    "dsc_mean",
    "dsc_median",
    "hd95_mm_mean",
    "hd95_mm_median",
    "hd95_px_mean",
    "hd95_px_median",
    "hd95_surfel_mm_mean",
    "missed_rate",
    "false_alarm_rate",
)


def mask_rows(pairs: MaskPairs, progress: Progress) -> Iterator[dict[str, Any]]:
    """Score each reference, in order of name.

    A missing prediction is an empty mask, which misses the vessel; where there is no vessel to miss it has no
    score. Pixels that the reference calls not labelled count in neither mask.

    Parameters
    ----------
    pairs : MaskPairs
        Masks to score.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    iterator of dict
        One row per reference.

    Raises
    ------
    InputError
        If masks differ in size or have other labels.
    """
    from models.metrics.scoring import CaseScore, columns_for, score_case

    columns = columns_for([pairs.spacing_mm])
    _require_labels(pairs)
    for name, path in progress.track(pairs.references.items(), "scoring masks", len(pairs.references)):
        reference = _mask(path, pairs.labels.reference)
        given = pairs.predictions.get(name)
        if given is not None:
            predicted = _prediction(given, path, reference.shape, pairs)
            if pairs.labels.ignored is not None:
                predicted &= ~_mask(path, (pairs.labels.ignored,))
            score = score_case(predicted, reference, pairs.spacing_mm)
        elif reference.any():
            score = score_case(np.zeros_like(reference), reference, pairs.spacing_mm)
        else:
            score = CaseScore()
        yield {
            "case_id": name,
            "missing": given is None,
            **{column: getattr(score, column) for column in columns},
        }


def mask_metrics(cases: pd.DataFrame) -> dict[str, float]:
    """Summarise all scores.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows that ``mask_rows`` returns.

    Returns
    -------
    dict
        Summary by metric name, with the number of cases and of missing predictions.
    """
    from models.metrics.scoring import CaseScore, summarise

    scores = {name: cases[name].tolist() for name in CaseScore.__dataclass_fields__ if name in cases}
    return summarise(scores) | {"cases": float(len(cases)), "cases_missing": float(cases["missing"].sum())}


def describe_masks(cases: pd.DataFrame, metrics: Mapping[str, float], pairs: MaskPairs) -> tuple[str, ...]:
    """State what was found.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows that ``mask_rows`` returns.
    metrics : Mapping[str, float]
        Metrics that ``mask_metrics`` returns.
    pairs : MaskPairs
        Masks that were scored.

    Returns
    -------
    tuple of str
        Sentences.
    """
    unit = "px" if pairs.spacing_mm is None else "mm"
    shown = int(cases["missed"].notna().sum())
    findings = []
    if shown:
        findings.append(
            f"{shown} masks with a vessel: mean DSC {metrics['dsc_mean']:.3f} (median {metrics['dsc_median']:.3f}), "
            f"mean HD95 {metrics[f'hd95_{unit}_mean']:.2f} {unit}, {int(cases['missed'].sum())} vessels missed."
        )
    empty = int(cases["false_alarm"].notna().sum())
    if empty:
        findings.append(f"{empty} masks without a vessel: {int(cases['false_alarm'].sum())} false alarms.")
    if pairs.missing:
        findings.append(
            f"{len(pairs.missing)} of {len(cases)} predictions are missing and count as misses "
            f"(first: {pairs.missing[0]})."
        )
    if pairs.unused:
        findings.append(
            f"{len(pairs.unused)} predictions have no reference and are not scored (first: {pairs.unused[0]})."
        )
    if pairs.labels.reference is not None:
        findings.append(f"The vessel is label {_listed(pairs.labels.reference)} of the reference masks.")
    if pairs.spacing_mm is None:
        findings.append("Distances are in pixels: pass spacing_mm=<mm a pixel> to have them in millimetres.")
    return tuple(findings)


def mask_table(metrics: Mapping[str, float]) -> pd.DataFrame:
    """Tabulate the means that are quoted.

    Parameters
    ----------
    metrics : Mapping[str, float]
        Metrics that ``mask_metrics`` returns.

    Returns
    -------
    pandas.DataFrame
        One row.
    """
    import pandas as pd

    quoted = {name: metrics[name] for name in QUOTED if name in metrics}
    return pd.DataFrame([{name: int(value) if name in COUNTS else value for name, value in quoted.items()}])


def _require_labels(pairs: MaskPairs) -> None:
    """Raise InputError where no reference has the label that is scored, or predictions have other labels than these.

    Predictions with labels that references do not hold, or with others alone, were written in another way: they would
    be scored as empty.
    """
    wanted, predicted = pairs.labels.reference, pairs.labels.prediction
    if wanted is None or predicted is None:
        return
    held = _held(pairs.references.values(), wanted)
    if not held & set(wanted):
        raise InputError(
            f"label: expected one that the reference masks hold ({_listed(held)}), received {_listed(wanted)}"
        )
    found = _held(pairs.predictions.values(), predicted)
    foreign = found - {0, *predicted} - held
    others = found - {0, *predicted}
    if foreign or (others and not found & set(predicted)):
        raise InputError(
            f"prediction: expected masks with the label {_listed(predicted)} and other labels of the reference "
            f"({_listed(held)}), received {_listed(found)}; pass prediction_label=<label of the vessel there>"
        )


def _held(paths: Collection[Path], vessel: tuple[int, ...]) -> set[int]:
    """The values that masks hold, each decoded as a label image."""
    held: set[int] = set()
    for path in paths:
        held |= set(np.unique(read_labels(path, vessel, ANY_LABEL)).tolist())
    return held


def _listed(labels: Collection[int]) -> str:
    return ", ".join(map(str, sorted(labels)))


def _mask(path: Path, labels: tuple[int, ...] | None) -> np.ndarray:
    if labels is not None:
        return np.isin(read_labels(path, labels, ANY_LABEL), labels)
    try:
        return read_mask(path, VESSEL, BACKGROUND)
    except InputError as refusal:
        if "expected labels" not in str(refusal):
            raise
        raise InputError(f"{refusal}; pass label=<the vessel's> for masks of several labels") from refusal


def _prediction(path: Path, reference: Path, size: tuple[int, ...], pairs: MaskPairs) -> np.ndarray:
    found = _mask(path, pairs.labels.prediction)
    if found.shape != size:
        raise InputError(
            f"{path}: expected the size of its reference {reference}, {size[1]}x{size[0]}, "
            f"received {found.shape[1]}x{found.shape[0]}"
        )
    return found
