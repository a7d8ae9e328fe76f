"""Study ``export_runs``: write tracked runs as Parquet, to be committed and restored elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from experiments.outcome import Outcome, Progress
from experiments.run_archive import write_archive
from experiments.run_record import RunRecord, read_run
from experiments.tracking import Store

TRACKED = False


def run(*, experiments: list[str] | None, archive: str, store: Store, progress: Progress) -> Outcome:
    """Export every ended run of ``experiments`` (null: all) into the folder ``archive``, beside what is there.

    A run that is still RUNNING is left out: it has no result yet.
    """
    names = {e.experiment_id: e.name for e in store.client().search_experiments()}

    def ended() -> Iterator[RunRecord]:
        for run_ in progress.track(
            store.runs(experiments, "attributes.status != 'RUNNING'"), "Exporting runs"
        ):
            yield read_run(store, run_.info.run_id, names[run_.info.experiment_id])

    count = write_archive(ended(), Path(archive).expanduser())
    return Outcome(metrics={"runs": count}, findings=(f"Exported {count} runs to {archive}.",))
