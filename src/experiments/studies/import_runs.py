"""Study ``import_runs``: restore exported runs into the tracker."""

from __future__ import annotations

from pathlib import Path

from experiments.outcome import Outcome, Progress
from experiments.tracking import Store, origin_of
from experiments.tracking.archive import read_archive
from experiments.tracking.external_training import is_training, read_training
from experiments.tracking.run_record import RunRecord, restore_run
from experiments.tracking.undelivered import complete_run

TRACKED = False


def run(*, experiments: list[str] | None, archive: str, store: Store, progress: Progress) -> Outcome:
    """Restore the runs in the folder ``archive`` that the tracker does not have yet.

    A run is known by its first id, which it keeps as a tag through every export and import, so a second
    import adds nothing. A run that the tracker believes failed, or whose import was stopped, is completed in its
    place.

    Parameters
    ----------
    experiments : list of str or None
        Names of the experiments; None for all.
    archive : str
        Folder of the archive, or of a training by ``python -m models.train``.
    store : Store
        Store of the tracker's runs.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Numbers of restored and of known runs, and findings.
    """
    # Newest first: of two runs with one origin, the newer stays under its name.
    runs = list(store.runs())[::-1]
    known = {origin_of(run_): run_.info.run_id for run_ in runs}
    incomplete = {run_.info.run_id for run_ in runs if not store.is_under_way(run_)}
    status = {run_.info.run_id: run_.info.status for run_ in runs}
    folder = Path(archive).expanduser()
    records = [read_training(folder)] if is_training(folder) else list(read_archive(folder, experiments))
    added = 0
    for record in progress.track(records, "Importing runs"):
        if record.run_id not in known:
            known[record.run_id] = restore_run(store, record, known.get(record.parent_id or ""))
        elif _lacks(status.get(there := known[record.run_id]), record) and there in incomplete:
            complete_run(store, record, there)
        else:
            continue
        added += 1
    skipped = len(records) - added
    return Outcome(
        metrics={"runs": added, "runs_known": skipped},
        findings=(f"Imported {added} runs from {archive}; {skipped} were already there.",),
    )


def _lacks(status: str | None, record: RunRecord) -> bool:
    """Whether the tracker lacks the end of a run: it lost the server, or the process that copied it was killed."""
    return status == "RUNNING" or (status == "FAILED" and record.status == "FINISHED")
