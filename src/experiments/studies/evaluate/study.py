"""Anyone's masks or transforms, scored as the studies score their own."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import files
from experiments.analysis.registration.benchmark.cases import differences
from experiments.analysis.registration.benchmark.deformed import (
    deformed_metrics,
    deformed_table,
    describe_deformed,
)
from experiments.analysis.registration.benchmark.figures import benchmark_figures
from experiments.analysis.registration.benchmark.findings import describe_benchmark
from experiments.analysis.registration.benchmark.metrics import benchmark_metrics
from experiments.analysis.registration.benchmark.tables import benchmark_tables
from experiments.analysis.registration.pose_scores import plain_metrics
from experiments.errors import InputError
from experiments.inputs.paths import input_data, require_exists
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting
from experiments.studies.evaluate.displacements import displacement_beside
from experiments.studies.evaluate.mask_pairs import MaskLabels, MaskPairs, pair_masks
from experiments.studies.evaluate.masks import describe_masks, mask_metrics, mask_rows, mask_table
from experiments.studies.evaluate.transforms import (
    TransformPairs,
    are_transforms,
    pair_transforms,
    target_notes,
    transform_rows,
)
from registration.benchmark.blocks import SUBSETS, blocks_of, collection_name
from registration.benchmark.case_files import TRUTH

if TYPE_CHECKING:
    import pandas as pd

MASKS, TRANSFORMS = "masks", "transforms"
PER_CASE = "evaluation.csv"


def implicit_paths(config: Mapping[str, Any]) -> Iterator[Path]:
    """List what is read though no setting names it: cases around their truth, a displacement next to its pose.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.

    Returns
    -------
    iterator of Path
        Paths.
    """
    reference = Path(str(config["reference"])).expanduser()
    if reference.name == TRUTH:
        yield reference.parent
    beside = displacement_beside(Path(str(config["prediction"])).expanduser())
    if beside is not None:
        yield beside


def check(
    *,
    prediction: PathSetting,
    reference: PathSetting,
    spacing_mm: Any,
    targets: PathSetting | None,
    label: Any = None,
    prediction_label: Any = None,
    ignore_label: Any = None,
) -> None:
    """Check that the files belong together.

    Parameters
    ----------
    prediction : PathSetting
        File or folder of predicted masks or transforms.
    reference : PathSetting
        File or folder of reference masks or true transforms.
    spacing_mm : Any
        Pixel size of masks in mm: one number, two (vertical, horizontal) or None.
    targets : PathSetting or None
        File of the points at which transforms are compared; None for the references' own.
    label : Any, optional
        Label or labels of the vessel in the reference masks, or None.
    prediction_label : Any, optional
        Label or labels of the vessel in the predicted masks; None for ``label``.
    ignore_label : Any, optional
        Label of pixels in the reference masks that nobody labelled, or None.

    Raises
    ------
    InputError
        If the files do not belong together, or a setting does not apply to them.
    """
    labels = MaskLabels.of(label, prediction_label, ignore_label)
    given, truth = require_exists(prediction, "prediction"), require_exists(reference, "reference")
    if are_transforms(truth):
        if spacing_mm is not None:
            raise InputError(f"spacing_mm: expected none with transforms, received {spacing_mm!r}")
        if labels.reference is not None:
            raise InputError(f"label: expected none with transforms, received {label!r}")
        pair_transforms(given, truth, targets)
    else:
        if targets is not None:
            raise InputError(f"targets: expected none with masks, received {targets!r}")
        pair_masks(given, truth, spacing_mm, labels)


def run(
    *,
    prediction: PathSetting,
    reference: PathSetting,
    spacing_mm: Any,
    targets: PathSetting | None,
    workspace: Path,
    progress: Progress,
    label: Any = None,
    prediction_label: Any = None,
    ignore_label: Any = None,
) -> Outcome:
    """Score every case of ``reference``.

    Leaves ``evaluation.json`` and ``evaluation.csv`` in ``workspace``. Masks are scored by DSC, HD95, misses
    and false alarms, transforms by their target registration error. The CSV file has one row per case. A case
    without a prediction has failed.

    Parameters
    ----------
    prediction : PathSetting
        File or folder of predicted masks or transforms.
    reference : PathSetting
        File or folder of reference masks or true transforms.
    spacing_mm : Any
        Pixel size of masks in mm: one number, two (vertical, horizontal) or None.
    targets : PathSetting or None
        File of the points at which transforms are compared; None for the references' own.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.
    label : Any, optional
        Label or labels of the vessel in the reference masks, or None.
    prediction_label : Any, optional
        Label or labels of the vessel in the predicted masks; None for ``label``.
    ignore_label : Any, optional
        Label of pixels in the reference masks that nobody labelled, or None.

    Returns
    -------
    Outcome
        Metrics, cases, tables and findings.

    Raises
    ------
    InputError
        If the files do not belong together or cannot be read.
    """
    check(
        prediction=prediction,
        reference=reference,
        spacing_mm=spacing_mm,
        targets=targets,
        label=label,
        prediction_label=prediction_label,
        ignore_label=ignore_label,
    )
    given, truth = Path(prediction), Path(reference)
    if are_transforms(truth):
        return _transforms(given, truth, targets, workspace, progress)
    labels = MaskLabels.of(label, prediction_label, ignore_label)
    return _masks(pair_masks(given, truth, spacing_mm, labels), (given, truth), workspace, progress)


def _masks(pairs: MaskPairs, paths: tuple[Path, Path], workspace: Path, progress: Progress) -> Outcome:
    import pandas as pd

    given, truth = paths
    cases = pd.DataFrame(list(mask_rows(pairs, progress)))
    if not cases["missed"].notna().any():
        raise InputError(
            f"reference: expected masks with a vessel, received {len(cases)} empty ones in {truth}"
        )
    metrics = mask_metrics(cases)
    about = {
        "spacing_mm": None if pairs.spacing_mm is None else list(pairs.spacing_mm),
        "labels": {name: value for name, value in vars(pairs.labels).items() if value is not None},
        "missing": pairs.missing,
        "not_scored": list(pairs.unused),
    }
    _write(workspace, MASKS, (given, truth), about, metrics, cases)
    return Outcome(
        metrics=metrics,
        cases=cases,
        tables={"masks": mask_table(metrics)},
        findings=(*describe_masks(cases, metrics, pairs), _where()),
        tags={"evaluated": MASKS},
        inputs=(input_data(given), input_data(truth)),
    )


def _transforms(
    given: Path, truth: Path, targets: PathSetting | None, workspace: Path, progress: Progress
) -> Outcome:
    import pandas as pd

    pairs = pair_transforms(given, truth, targets)
    name = given.stem if given.is_file() else given.name
    cases = pd.DataFrame(list(transform_rows(pairs, progress))).assign(method=name)
    metrics = benchmark_metrics(cases) | deformed_metrics(cases)
    missing = [case for case in pairs.references if case not in pairs.predictions]
    about = {"targets": targets, "missing": missing, "not_scored": list(pairs.unused)}
    _write(workspace, TRANSFORMS, (given, truth), about, metrics, cases)
    notes = [*target_notes(pairs, targets), *_frozen(pairs)]
    if missing:
        notes.append(
            f"{len(missing)} of {len(cases)} cases have no file and count as failed (first: {missing[0]})."
        )
    if pairs.unused:
        notes.append(
            f"{len(pairs.unused)} files belong to no case and are not scored (first: {pairs.unused[0]})."
        )
    return Outcome(
        metrics=metrics,
        cases=cases,
        tables=benchmark_tables(cases) | deformed_table(cases),
        figures=benchmark_figures(cases) if len(cases) > 1 else {},
        findings=(*describe_benchmark(cases), *describe_deformed(cases), *notes, _where()),
        tags={"evaluated": TRANSFORMS, "simulated": str(bool(cases["simulated"].all())).lower()},
        inputs=(input_data(given), input_data(truth)),
    )


def _frozen(pairs: TransformPairs) -> list[str]:
    """What is to be said of the benchmark's cases where they are not the frozen ones."""
    known = [collection_name(subset, block) for subset in SUBSETS for block in blocks_of(subset)]
    if pairs.cases is None or pairs.cases.name not in known:
        return []
    return list(differences(pairs.cases, list(pairs.references), pairs.cases.name))


def _write(
    workspace: Path,
    kind: str,
    paths: tuple[Path, Path],
    about: Mapping[str, Any],
    metrics: Mapping[str, float],
    cases: pd.DataFrame,
) -> None:
    """Write both files; a number that is not finite is null in the one and inf or empty in the other."""
    report = {
        "kind": kind,
        "prediction": str(paths[0]),
        "reference": str(paths[1]),
        **about,
        "cases": len(cases),
        "metrics": plain_metrics(metrics),
    }
    files.write_text(workspace / "evaluation.json", json.dumps(report, indent=2, allow_nan=False) + "\n")
    files.write_text(workspace / PER_CASE, cases.to_csv(index=False))


def _where() -> str:
    return f"evaluation.json holds the summary, {PER_CASE} a row a case."
