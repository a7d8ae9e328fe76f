"""What every page of results is made of: the cases that a study wrote, its findings as a list, its figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from experiments import files
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome
from experiments.reporting.figure_files import save_figure
from experiments.running.job_names import choices_of
from experiments.tracking import LABEL_TAG
from experiments.tracking.archive import read_archive
from experiments.tracking.run_record import RunRecord, config_of, last_metrics

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

# What a study makes of its cases: tables, figures and findings.
Shown: TypeAlias = "Callable[[pd.DataFrame], Outcome]"
DPI = 110


def read_cases(folder: Path, writer: str, subset: str = "") -> pd.DataFrame:
    """Read the per-case table of a study.

    Parameters
    ----------
    folder : Path
        Folder that the study wrote, or that holds one folder for each subset.
    writer : str
        What writes the folder and its verb, such as ``study=robustness wrote``, for the message.
    subset : str, optional
        Name of the subset's folder within ``folder``.

    Returns
    -------
    pandas.DataFrame
        One row a case.

    Raises
    ------
    InputError
        If there is no such table.
    """
    path = folder / subset / "cases.parquet"
    if not path.is_file():
        raise InputError(f"{folder}: expected the folder that {writer}, found none")
    return files.read_table(path)


def finished_jobs(archive: Path, study: str) -> Iterator[RunRecord]:
    """Read the finished runs of a study's jobs from an archive.

    Parameters
    ----------
    archive : Path
        Folder of exported runs.
    study : str
        Name of the study.

    Yields
    ------
    RunRecord
        Each run.
    """
    for run in read_archive(archive, [study]):
        if run.tags.get("ctus.kind") == "job" and run.status == "FINISHED":
            yield run


def archived_result(run: RunRecord) -> JobResult:
    """Take an exported run for the result of a job, as the summary of its study does.

    Parameters
    ----------
    run : RunRecord
        Run of a job.

    Returns
    -------
    JobResult
        Its result; the workspace is none that exists.
    """
    choices = choices_of(run.tags.get(LABEL_TAG, ""))
    return JobResult(
        config_of(run.config), last_metrics(run), run.cases, Path(run.run_id), run.run_id, choices
    )


def listed(findings: Iterable[str]) -> str:
    """Write sentences as a Markdown list.

    Parameters
    ----------
    findings : iterable of str
        Sentences.

    Returns
    -------
    str
        One line a sentence, without a line end after the last.
    """
    return "\n".join(f"- {sentence}" for sentence in findings)


def save_page_figure(figure: Figure, stem: Path) -> None:
    """Write a figure as PNG in the resolution of all pages.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Figure to write.
    stem : Path
        Path without suffix.
    """
    save_figure(figure, stem, ("png",), dpi=DPI)
