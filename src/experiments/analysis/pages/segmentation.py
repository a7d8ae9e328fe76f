"""Page of the segmentation studies on USGRA, from exported runs: no training is repeated for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from experiments import files
from experiments.analysis.pages.page_parts import archived_result, finished_jobs, listed
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome
from experiments.running.terminal import markdown
from experiments.tracking.run_record import RunRecord

HEAD = """# Segmentation of USGRA's vessels

204 in-vivo images of five body regions (tmkand/usgra-seg, CC BY 4.0), 128x128, about 2 M parameters, 3 folds by groups
of near-identical images, 30 epochs, on two CPU cores. Out-of-fold scores at native resolution; no pixel spacing is
known, so distances are in pixels. Written by `python scripts/segmentation_results.py` from the runs in `results/runs`.

"""
COMMANDS = {
    "segmentation": (
        "ctus -m study=segmentation dataset=usgra dataset.root=<folder> trainer=cpu "
        "model=unet,basic_unet,attention_unet,unet3plus"
    ),
    "domain_transfer": (
        "ctus study=domain_transfer dataset@first=phantom dataset@second=usgra second.root=<folder> trainer=cpu"
    ),
}
TITLES = {"segmentation": "Networks", "domain_transfer": "Simulator to USGRA and back"}


def write_page(
    archive: Path, out: Path, summarise: Mapping[str, Callable[[list[JobResult]], Outcome]]
) -> None:
    """Write the page with one section for each study.

    Parameters
    ----------
    archive : Path
        Folder of exported runs.
    out : Path
        File of the page.
    summarise : Mapping[str, callable]
        What makes tables and findings of a study's jobs, by the study's name in the order of the sections.

    Raises
    ------
    InputError
        If the archive has no finished runs of a study.
    """
    parts = [HEAD]
    for study, summary in summarise.items():
        runs = sorted(finished_jobs(archive, study), key=lambda run: run.start_ms)
        if not runs:
            raise InputError(f"{archive}: expected finished runs of {study}, found none")
        parts.append(_section(study, summary([archived_result(run) for run in runs]), runs))
    files.write_text(out, "\n".join(parts).strip() + "\n")


def _section(study: str, outcome: Outcome, runs: list[RunRecord]) -> str:
    commits = sorted({run.tags.get("mlflow.source.git.commit", "unknown")[:12] for run in runs})
    machines = sorted({run.tags.get("ctus.machine", "unknown") for run in runs})
    return (
        f"## {TITLES[study]}\n\n```\n{COMMANDS[study]}\n```\n\nCommit {', '.join(commits)}; {len(runs)} runs; "
        f"{', '.join(machines)}.\n\n{markdown(dict(outcome.tables))}\n{listed(outcome.findings)}\n"
    )
