"""What is said of a run that was run again: counts, tables, sentences and ``reproduction.json``."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import files
from experiments.analysis.runs.case_difference import Difference
from experiments.analysis.runs.difference import Compared
from experiments.outcome import Outcome
from experiments.studies.reproduce.checks import Check, differing
from experiments.tracking.run_lookup import Family
from experiments.tracking.run_record import RunRecord

if TYPE_CHECKING:
    import pandas as pd

# Rows of a table of differences; all of them stand in reproduction.json.
MOST_SHOWN = 20
COUNTS = {
    "numbers": ("numbers", "different_numbers"),
    "curve_values": ("values of curves", "different_curve_values"),
    "texts": ("results in words", "different_texts"),
}


@dataclass(frozen=True)
class Reproduced:
    """A run and the same run again.

    Parameters
    ----------
    original : RunRecord
        The run.
    again : RunRecord or None
        The same run again; None if it did not finish.
    compared : Compared or None
        How they differ; None if it did not finish.
    """

    original: RunRecord
    again: RunRecord | None
    compared: Compared | None


@dataclass(frozen=True)
class Reproduction:
    """All of a run that was run again.

    Parameters
    ----------
    family : Family
        The run that was asked for, with those below it.
    pairs : tuple of Reproduced
        Its jobs and, of a complete sweep, the sweep itself.
    checks : tuple of Check
        What it was made with and what is here.
    tolerance : float
        Largest difference that counted as equal.
    whole : bool
        Whether all jobs of the run had finished.
    """

    family: Family
    pairs: tuple[Reproduced, ...]
    checks: tuple[Check, ...]
    tolerance: float
    whole: bool

    @property
    def compared(self) -> list[Compared]:
        """The comparisons that could be made."""
        return [pair.compared for pair in self.pairs if pair.compared is not None]

    @property
    def equal(self) -> bool:
        """Whether every run came out the same, from data that are not known to be others."""
        other_data = any(check.what.startswith("data ") and check.same is False for check in self.checks)
        every = len(self.compared) == len(self.pairs) and all(each.equal for each in self.compared)
        return every and not other_data


def last_value(record: RunRecord, metric: str) -> float | None:
    """The last value of a metric of a run.

    Parameters
    ----------
    record : RunRecord
        The run.
    metric : str
        Name of the metric.

    Returns
    -------
    float or None
        The value; None if the run has none.
    """
    rows = record.history[record.history["metric"] == metric]
    return None if not len(rows) else float(rows.sort_values("timestamp_ms", kind="stable")["value"].iloc[-1])


def outcome(done: Reproduction) -> Outcome:
    """Make the result of the study.

    Parameters
    ----------
    done : Reproduction
        The run and the same run again.

    Returns
    -------
    Outcome
        Metrics, tables, findings and ``reproduction.json``; refused where the run did not come out the same.
    """
    verdict = _verdict(done)
    return Outcome(
        metrics=_metrics(done),
        tables=_tables(done),
        findings=(verdict, *_largest(done), *_notes(done)),
        files={"reproduction.json": partial(_write, done)},
        refused=() if done.equal else (verdict,),
    )


def _metrics(done: Reproduction) -> dict[str, float]:
    found = {"equal": float(done.equal), "runs": float(len(done.pairs))}
    found["runs_equal"] = float(sum(each.equal for each in done.compared))
    for name, (_, different) in COUNTS.items():
        found[name] = float(sum(getattr(each, name) for each in done.compared))
        found[different] = float(sum(len(getattr(each, different)) for each in done.compared))
    found["rows"] = float(sum(each.rows for each in done.compared))
    found["different_rows"] = float(sum(each.different_rows for each in done.compared))
    return found


def _verdict(done: Reproduction) -> str:
    top = done.family.run
    numbers = _metrics(done)
    counts = [
        f"{numbers[name] - numbers[different]:.0f} of {numbers[name]:.0f} {words}"
        for name, (words, different) in COUNTS.items()
        if numbers[name]
    ]
    if numbers["rows"]:
        counts.append(
            f"{numbers['rows'] - numbers['different_rows']:.0f} of {numbers['rows']:.0f} rows of cases"
        )
    wanted = "bit-equal" if done.tolerance == 0 else f"equal within {done.tolerance:g}"
    lost = len(done.pairs) - len(done.compared)
    said = f"{wanted if done.equal else f'not {wanted}'}: {', '.join(counts) or 'nothing'} the same"
    if lost:
        said += f"; {lost} of {len(done.pairs)} runs did not finish when run again"
    return f"Run {top.run_id[:12]} ({top.experiment}, {top.name}) is {said}."


def _largest(done: Reproduction) -> list[str]:
    """The number, the value of a curve and the column that differ most."""
    said = []
    for field, words in (
        ("different_numbers", "Number"),
        ("different_curve_values", "First value of a curve"),
        ("different_columns", "Column of cases"),
    ):
        found = [(pair, each) for pair in done.pairs for each in getattr(pair.compared, field, ())]
        if not found:
            continue
        # A curve that differs once differs from there on: the step where it begins says more than the largest gap.
        first = field == "different_curve_values"
        chosen = (
            min(found, key=lambda item: _step(item[1]))
            if first
            else max(found, key=lambda item: _rank(item[1]))
        )
        said.append(f"{words} that differs{'' if first else ' most'}: {_described(*chosen)}.")
    return said


def _described(pair: Reproduced, each: Difference) -> str:
    place = f" at {each.place}" if each.place else ""
    of = f" of {pair.original.name}" if pair.original.name else ""
    by = f", by {each.size:.3g}" if not math.isnan(each.size) else ""
    rows = f" ({each.rows} rows differ)" if each.rows > 1 else ""
    return f"{each.name}{of}{place}, {_shown(each.original)} and again {_shown(each.reproduced)}{by}{rows}"


def _notes(done: Reproduction) -> list[str]:
    said = []
    left_out = dict.fromkeys(name for each in done.compared for name in each.left_out)
    if left_out:
        said.append(f"Left out, as they differ every time: {', '.join(left_out)}.")
    if not done.whole:
        said.append(
            "Not all jobs of the sweep had finished: only those that had are run again, not its summary."
        )
    if found := differing(done.checks):
        said.append(f"Not as it was: {'; '.join(found)}.")
    machine = next((check for check in done.checks if check.what == "machine" and not check.same), None)
    if machine is not None:
        said.append(
            f"Made on another machine ({machine.recorded}; here {machine.now}), whose arithmetic may differ in the "
            "last bits; a training carries these on."
        )
    taken = next((check.now for check in done.checks if check.what == "settings"), None)
    if taken:
        said.append(f"Settings that the run did not have yet, at today's default: {taken}.")
    return said


def _tables(done: Reproduction) -> dict[str, pd.DataFrame]:
    import pandas as pd

    made = pd.DataFrame(
        [
            {"check": check.what, "recorded": check.recorded, "here": check.now, "same": _yes(check.same)}
            for check in done.checks
        ]
    )
    rows = [
        {
            "run": pair.original.name,
            "name": each.name,
            "place": each.place,
            "original": _shown(each.original),
            "again": _shown(each.reproduced),
            "difference": each.size,
            "rows": each.rows,
        }
        for pair in done.pairs
        if pair.compared is not None
        for each in pair.compared.differences
    ]
    rows.sort(key=lambda row: -_finite(float(str(row["difference"]))))
    title = "differences" + (f" (first {MOST_SHOWN} of {len(rows)})" if len(rows) > MOST_SHOWN else "")
    found = {"what it was made with": made}
    return found | ({title: pd.DataFrame(rows[:MOST_SHOWN])} if rows else {})


def _write(done: Reproduction, path: Path) -> None:
    content = {
        "run": done.family.run.run_id,
        "study": done.family.run.experiment,
        "name": done.family.run.name,
        "tolerance": done.tolerance,
        "equal": done.equal,
        "all_jobs_had_finished": done.whole,
        "checks": [asdict(check) for check in done.checks],
        "runs": [_pair(pair) for pair in done.pairs],
    }
    files.write_text(path, json.dumps(content, indent=1, default=str))


def _pair(pair: Reproduced) -> dict[str, Any]:
    about = {
        "run": pair.original.run_id,
        "name": pair.original.name,
        "finished_again": pair.again is not None,
    }
    if pair.compared is None:
        return about
    numbers = {name: getattr(pair.compared, name) for name in (*COUNTS, "rows", "columns", "different_rows")}
    rows = [{**asdict(each), "size": _json(each.size)} for each in pair.compared.differences]
    for row in rows:
        row |= {name: _json(row[name]) for name in ("original", "reproduced")}
    return {
        **about,
        "equal": pair.compared.equal,
        **numbers,
        "left_out": pair.compared.left_out,
        "differences": rows,
    }


def _json(value: object) -> object:
    # JSON has no NaN or infinity.
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _shown(value: object) -> str:
    return (
        repr(float(value)) if isinstance(value, (int, float)) and not isinstance(value, bool) else str(value)
    )


def _rank(each: Difference) -> float:
    return _finite(each.size)


def _finite(size: float) -> float:
    return math.inf if math.isnan(size) else size


def _step(each: Difference) -> int:
    return int(each.place.rpartition(" ")[2] or 0)


def _yes(same: bool | None) -> str:
    return {True: "yes", False: "no", None: "unknown"}[same]
