"""What a sweep of registrations ends with: a row for each, by what sets it apart."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from experiments.outcome import JobResult, Outcome

if TYPE_CHECKING:
    import pandas as pd

SHOWN = (
    "rmse_mm",
    "inlier_share",
    "predicted_tre_low_mm",
    "predicted_tre_high_mm",
    "tre_mm",
    "deformed_rmse_mm",
)
# Where the results go and how the call was written sets no two registrations apart.
_OF_THE_CALL = ("out", "call", "rigid", "deformable")


def summarise(results: Sequence[JobResult]) -> Outcome:
    """Tabulate all registrations of a sweep, with the verdict of each.

    Parameters
    ----------
    results : sequence of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        One table and a sentence; no metrics, which would mix files or methods.
    """
    import pandas as pd

    rows = [
        {**apart, "verdict": _verdict(result), **{name: result.metrics.get(name) for name in SHOWN}}
        for result, apart in zip(results, _what_varies(results), strict=True)
    ]
    table: pd.DataFrame = pd.DataFrame(rows).dropna(axis="columns", how="all")
    counts = table["verdict"].value_counts()
    found = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    return Outcome(tables={"Registrations": table}, findings=(f"Of {len(rows)} registrations: {found}.",))


def _what_varies(results: Sequence[JobResult]) -> list[dict[str, Any]]:
    """The methods of each registration, and its settings of one value that are not those of all others."""
    methods = [
        {name: ", ".join(result.config[name]) for name in ("rigid", "deformable")} for result in results
    ]
    plain = [
        {
            name: value
            for name, value in result.config.items()
            if name not in _OF_THE_CALL and not isinstance(value, (Mapping, list))
        }
        for result in results
    ]
    varying = [name for name in plain[0] if len({str(each.get(name)) for each in plain}) > 1]
    return [
        {**method, **{name: each.get(name) for name in varying}}
        for method, each in zip(methods, plain, strict=True)
    ]


def _verdict(result: JobResult) -> str:
    path = result.workspace / "registration.json"
    return str(json.loads(path.read_text(encoding="utf-8"))["verdict"]) if path.is_file() else ""
