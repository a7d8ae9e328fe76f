"""Anyone's masks beside reference masks: which files belong together, and a row of scores for each case."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.datasets.reading import image_files, read_mask
from experiments.errors import InputError
from experiments.outcome import Progress

if TYPE_CHECKING:
    import pandas as pd

# Masks hold 0 and 1, or 0 and 255.
VESSEL, BACKGROUND = (1, 255), (0,)
QUOTED = (
    "cases",
    "cases_missing",
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


@dataclass(frozen=True)
class MaskPairs:
    """Reference masks by name, predicted masks of the same names, and predictions that have no reference.

    ``spacing_mm`` is (vertical, horizontal), None where it is not known.
    """

    references: Mapping[str, Path]
    predictions: Mapping[str, Path]
    unused: tuple[str, ...]
    spacing_mm: tuple[float, float] | None

    @property
    def missing(self) -> list[str]:
        """The references without a prediction."""
        return [name for name in self.references if name not in self.predictions]


def pair_masks(prediction: Path, reference: Path, spacing_mm: Any) -> MaskPairs:
    """Say which prediction belongs to which reference, by name; one file goes with one file whatever their names.

    Raises InputError for paths that are not there, a folder against a file, folders that share no name, or a spacing
    that is none.
    """
    spacing = require_spacing(spacing_mm)
    if reference.is_file() and prediction.is_file():
        return MaskPairs({reference.stem: reference}, {reference.stem: prediction}, (), spacing)
    if reference.is_file() or prediction.is_file():
        kinds = {True: "a file", False: "a folder"}
        raise InputError(
            f"prediction: expected {kinds[reference.is_file()]}, as reference is, received "
            f"{kinds[prediction.is_file()]} {prediction}"
        )
    references, found = image_files(reference), image_files(prediction)
    predictions = {name: path for name, path in found.items() if name in references}
    if not predictions:
        raise InputError(
            f"prediction: expected masks named as those in {reference} ({next(iter(references))}, ...), "
            f"received none of these names in {prediction}"
        )
    unused = tuple(name for name in found if name not in references)
    return MaskPairs(references, predictions, unused, spacing)


def require_spacing(value: Any) -> tuple[float, float] | None:
    """A pixel's size in mm, (vertical, horizontal), from one number or two; None if it is not known."""
    if value is None:
        return None
    sides = list(value) if isinstance(value, (list, tuple)) else [value, value]
    known = all(isinstance(side, (int, float)) and not isinstance(side, bool) for side in sides)
    if len(sides) != 2 or not known or not all(np.isfinite(side) and side > 0 for side in sides):
        raise InputError(
            f"spacing_mm: expected one positive number, two (vertical, horizontal) or null, received {value!r}"
        )
    return float(sides[0]), float(sides[1])


def mask_rows(pairs: MaskPairs, progress: Progress) -> Iterator[dict[str, Any]]:
    """A row a reference, in order of name.

    A missing prediction is an empty mask, which misses the vessel; where there is no vessel to miss it has no score.
    Raises InputError for masks of different size or with other labels.
    """
    from models.scoring import CaseScore, columns_for, score_case

    columns = columns_for([pairs.spacing_mm])
    for name, path in progress.track(pairs.references.items(), "scoring masks", len(pairs.references)):
        reference = read_mask(path, VESSEL, BACKGROUND, _size(path))
        given = pairs.predictions.get(name)
        if given is not None:
            score = score_case(_prediction(given, path, reference.shape), reference, pairs.spacing_mm)
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
    """The summary of all scores, and how many predictions were missing."""
    from models.scoring import CaseScore, summarise

    scores = {name: cases[name].tolist() for name in CaseScore.__dataclass_fields__ if name in cases}
    return summarise(scores) | {"cases": float(len(cases)), "cases_missing": float(cases["missing"].sum())}


def describe_masks(cases: pd.DataFrame, metrics: Mapping[str, float], pairs: MaskPairs) -> tuple[str, ...]:
    """What was found, in sentences."""
    unit = "px" if pairs.spacing_mm is None else "mm"
    shown = int(cases["missed"].notna().sum())
    said = []
    if shown:
        said.append(
            f"{shown} masks with a vessel: mean DSC {metrics['dsc_mean']:.3f} (median {metrics['dsc_median']:.3f}), "
            f"mean HD95 {metrics[f'hd95_{unit}_mean']:.2f} {unit}, {int(cases['missed'].sum())} vessels missed."
        )
    empty = int(cases["false_alarm"].notna().sum())
    if empty:
        said.append(f"{empty} masks without a vessel: {int(cases['false_alarm'].sum())} false alarms.")
    if pairs.missing:
        said.append(
            f"{len(pairs.missing)} of {len(cases)} predictions are missing and count as misses "
            f"(first: {pairs.missing[0]})."
        )
    if pairs.unused:
        said.append(
            f"{len(pairs.unused)} predictions have no reference and are not scored (first: {pairs.unused[0]})."
        )
    if pairs.spacing_mm is None:
        said.append("Distances are in pixels: pass spacing_mm=<mm a pixel> to have them in millimetres.")
    return tuple(said)


def mask_table(metrics: Mapping[str, float]) -> pd.DataFrame:
    """One row: the means that are quoted."""
    import pandas as pd

    return pd.DataFrame([{name: metrics[name] for name in QUOTED if name in metrics}])


def _prediction(path: Path, reference: Path, size: tuple[int, ...]) -> np.ndarray:
    found = read_mask(path, VESSEL, BACKGROUND, _size(path))
    if found.shape != size:
        raise InputError(
            f"{path}: expected the size of its reference {reference}, {size[1]}x{size[0]}, "
            f"received {found.shape[1]}x{found.shape[0]}"
        )
    return found


def _size(path: Path) -> tuple[int, int]:
    """Height and width of an image, without its pixels."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            return image.height, image.width
    except OSError as refusal:
        raise InputError(f"{path}: expected an image, received a file that can't be read as one") from refusal
