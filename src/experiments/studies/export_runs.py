"""Study ``export_runs``: write tracked runs as Parquet, to be committed and restored elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from experiments.outcome import Outcome, Progress
from experiments.tracking import Store
from experiments.tracking.archive import write_archive
from experiments.tracking.run_record import RunRecord, read_run

TRACKED = False


def run(*, experiments: list[str] | None, archive: str, store: Store, progress: Progress) -> Outcome:
    """Export every ended run into the folder ``archive``, next to what is there.

    A run that is still RUNNING is left out: it has no result yet. Where it is a sweep, its jobs that finished are
    exported, and whoever reads the archive finds a KILLED run above them. Runs whose files are not where the tracker
    says they are are exported without configuration and table, and counted in the findings.

    Parameters
    ----------
    experiments : list of str or None
        Names of the experiments; None for all.
    archive : str
        Folder of the archive.
    store : Store
        Store of the tracker's runs.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Numbers of exported runs and of those without files, and findings.
    """
    names = {e.experiment_id: e.name for e in store.client().search_experiments()}

    bare: list[str] = []

    def ended() -> Iterator[RunRecord]:
        for run_ in progress.track(
            store.runs(experiments, "attributes.status != 'RUNNING'"), "Exporting runs"
        ):
            record = read_run(store, run_.info.run_id, names[run_.info.experiment_id])
            # Every run begins by logging its configuration.
            if not record.config:
                bare.append(f"{record.experiment} {run_.info.run_id}, {run_.info.artifact_uri}")
            yield record

    count = write_archive(ended(), Path(archive).expanduser())
    findings = [f"Exported {count} runs to {archive}."]
    if bare:
        findings.append(
            f"{len(bare)} of them have no files where the tracker says they are (first: {bare[0]}): they are exported "
            "without configuration and table, unless an earlier export has these."
        )
    return Outcome(metrics={"runs": count, "runs_without_files": len(bare)}, findings=tuple(findings))
