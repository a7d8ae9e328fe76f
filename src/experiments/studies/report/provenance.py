"""Where each number of a report comes from: runs, code, data, date, machine and cost."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from experiments.studies.report.sections import Section
from experiments.tracking import HASH_TAG
from experiments.tracking.run_record import RunRecord

if TYPE_CHECKING:
    import pandas as pd

COMMIT, DIRTY, MACHINE = "mlflow.source.git.commit", "ctus.git_dirty", "ctus.machine"
_DIGEST_LENGTH = 12


def provenance(sections: Sequence[Section]) -> pd.DataFrame:
    """Tabulate where the numbers of each section come from.

    Parameters
    ----------
    sections : sequence of Section
        Sections of the report.

    Returns
    -------
    pandas.DataFrame
        Texts, one row a section: its runs, commit, hash of the configuration, digests of the data, date, machine,
        seconds that its jobs took together, and the command.
    """
    import pandas as pd

    return pd.DataFrame([_row(section) for section in sections])


def job_runs(sections: Sequence[Section]) -> pd.DataFrame:
    """Tabulate every run that counts.

    Parameters
    ----------
    sections : sequence of Section
        Sections of the report.

    Returns
    -------
    pandas.DataFrame
        Texts, one row a run, with the topmost run that it belongs to.
    """
    import pandas as pd

    rows = [
        {
            "study": section.study,
            "sweep": section.run_id,
            "run": run.run_id,
            "name": run.name,
            "commit": _commit(run),
            "config_hash": run.tags.get(HASH_TAG, ""),
            "data": _data([run]),
            "seconds": f"{_seconds(run):.0f}",
        }
        for section in sections
        for run in _runs(section)
    ]
    return pd.DataFrame(rows)


def _runs(section: Section) -> list[RunRecord]:
    counted = {result.run_id for result in section.results}
    return [run for run in section.family.jobs if run.run_id in counted]


def _row(section: Section) -> dict[str, str]:
    runs, top = _runs(section), section.family.run
    return {
        "section": section.title,
        "run": section.run_id,
        "jobs": f"{len(runs)} of {len(section.family.jobs)}",
        "status": top.status,
        "commit": _several(_commit(run) for run in runs),
        "config_hash": str(top.tags.get(HASH_TAG, ""))[:_DIGEST_LENGTH],
        "data": _data(runs),
        "date": datetime.fromtimestamp(top.start_ms / 1000, UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "machine": _several(run.tags.get(MACHINE, "") for run in runs),
        "seconds": f"{sum(_seconds(run) for run in runs):.0f}",
        "command": str(top.tags.get("ctus.command", "")),
    }


def _commit(run: RunRecord) -> str:
    commit = run.tags.get(COMMIT, "")[:_DIGEST_LENGTH]
    return f"{commit} with changes" if commit and run.tags.get(DIRTY) == "true" else commit


def _data(runs: Iterable[RunRecord]) -> str:
    return _several(f"{data.name} {data.digest[:_DIGEST_LENGTH]}" for run in runs for data in run.inputs)


def _seconds(run: RunRecord) -> float:
    return (run.end_ms - run.start_ms) / 1000 if run.end_ms is not None else 0.0


def _several(texts: Iterable[str]) -> str:
    return ", ".join(dict.fromkeys(text for text in texts if text))
