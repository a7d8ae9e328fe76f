"""Study ``compare``: two tracked runs or sweeps side by side, by settings, metrics and paired tests."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import files
from experiments.analysis.runs.paired_cases import PairedCases, pair_cases
from experiments.analysis.runs.paired_tests import compare_runs
from experiments.errors import InputError
from experiments.outcome import Outcome
from experiments.studies.compare.figures import paired_differences
from experiments.studies.compare.report import describe, names_of, tests_table
from experiments.studies.compare.settings import differing_metrics, differing_settings
from experiments.tracking import Store
from experiments.tracking.run_lookup import Family, find_families

if TYPE_CHECKING:
    import pandas as pd

TRACKED = False
MOST_SHOWN = 30


def run(*, runs: Sequence[str], archive: str | None, unit: str | None, store: Store) -> Outcome:
    """Compare two runs, or two sweeps with all their jobs.

    Parameters
    ----------
    runs : sequence of str
        Ids of two runs, or the first characters of them.
    archive : str or None
        Folder of exported runs; None for the tracker.
    unit : str or None
        Column of the independent unit; None for the first of anatomy, group, phantom, sweep and case.
    store : Store
        The tracker.

    Returns
    -------
    Outcome
        Tables of settings, metrics and tests, a figure of the paired differences, and findings.

    Raises
    ------
    InputError
        If there are not two such runs of one study, or they have no case in common.
    """
    first, second = _two(runs, store, None if archive is None else Path(archive).expanduser())
    paired = pair_cases(first, second, unit)
    tested = compare_runs(paired)
    names = names_of(first, second)
    settings, metrics = differing_settings(first, second, names), differing_metrics(first, second, names)
    return Outcome(
        metrics=_metrics(paired, tested, settings),
        cases=paired.pairs,
        tables={
            **({"settings that differ": settings} if len(settings) else {}),
            **_shortened("metrics that differ", metrics),
            "paired tests": tests_table(tested, names),
        },
        figures={"paired_differences": paired_differences(paired, tested, names)},
        findings=describe(paired, tested, names, (first, second)),
        files={
            "settings.csv": _csv(settings),
            "metrics.csv": _csv(metrics),
            "tests.csv": _csv(tested),
            "comparison.json": partial(_write, first, second, paired, tested),
        },
    )


def _two(runs: Sequence[str], store: Store, archive: Path | None) -> tuple[Family, Family]:
    if isinstance(runs, str) or len(runs) != 2:
        raise InputError(f"runs: expected two ids, runs=[first,second], received {runs!r}")
    first, second = find_families([str(reference) for reference in runs], store, archive)
    if first.run.run_id == second.run.run_id:
        raise InputError(f"runs: expected two runs, received {first.run.run_id[:12]} twice")
    studies = [family.run.experiment for family in (first, second)]
    if studies[0] != studies[1]:
        raise InputError(
            f"runs: expected two of one study, received one of {studies[0]} and one of {studies[1]}"
        )
    return first, second


def _metrics(paired: PairedCases, tested: pd.DataFrame, settings: pd.DataFrame) -> dict[str, float]:
    found = {
        "cases": float(len(paired.pairs)),
        "cases_left_out": float(sum(paired.alone)),
        "units": float(paired.pairs[paired.unit].nunique()),
        "settings": float(len(settings)),
    }
    for row in tested.to_dict("records"):
        place = f"{row['method']}/" if row["method"] else ""
        for name in ("mean_difference", "p", "p_holm", "min_attainable_p"):
            found[f"{place}{row['metric']}_{name}"] = float(row[name])
    return found


def _shortened(title: str, table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    if len(table) > MOST_SHOWN:
        return {f"{title} (first {MOST_SHOWN} of {len(table)}; all in metrics.csv)": table.head(MOST_SHOWN)}
    return {title: table} if len(table) else {}


def _csv(table: pd.DataFrame) -> Callable[[Path], None]:
    return lambda path: table.to_csv(path, index=False)


def _write(first: Family, second: Family, paired: PairedCases, tested: pd.DataFrame, path: Path) -> None:
    content: dict[str, Any] = {
        "first": first.run.run_id,
        "second": second.run.run_id,
        "study": first.run.experiment,
        "unit": paired.unit,
        "cases": len(paired.pairs),
        "left_out": {"first": paired.alone[0], "second": paired.alone[1]},
        "notes": paired.notes,
        "tests": json.loads(tested.to_json(orient="records", double_precision=15)),
    }
    files.write_text(path, json.dumps(content, indent=1))
