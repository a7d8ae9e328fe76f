"""Study ``report``: published values beside measured ones, every table and figure, and one page, from tracked runs."""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from experiments import files
from experiments.errors import InputError
from experiments.outcome import Outcome, Progress
from experiments.reporting.figure_files import save_figure
from experiments.reporting.labels import counted
from experiments.reporting.published import published_values
from experiments.reporting.thesis_steps import thesis_steps
from experiments.running.terminal import markdown
from experiments.studies.report.latex import latex_document, latex_table
from experiments.studies.report.page import ShownFigure, ShownSection, ShownTable, page
from experiments.studies.report.provenance import job_runs, provenance
from experiments.studies.report.published_table import ID_LENGTH, NOT_MEASURED, published_table
from experiments.studies.report.sections import Section, Source, chosen, section_of
from experiments.tracking import Store

if TYPE_CHECKING:
    import pandas as pd

TRACKED = False
TABLES, FIGURES, PAGE, WRITTEN = "tables", "figures", "index.html", "report.json"
FIGURE_FILES = ("png", "svg", "pdf")
SCENE = "scene.html"
# Studies whose runs a report shows besides those that measure published values.
FURTHER = ("pipeline", "propagation", "error_budget", "consolidation", "domain_transfer")
# Columns of the rows that end the terminal's output.
SHOWN = ("study", "value", "published", "measured_on", "ours", "comparable")


def run(
    *,
    runs: Sequence[str],
    archive: str | None,
    out: str | None,
    replace: bool = False,
    store: Store,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Write tables, figures and a page of tracked runs.

    Parameters
    ----------
    runs : sequence of str
        Ids of the runs to show, or the first characters of them; none for the newest complete sweep of each study, data
        set and preset.
    archive : str or None
        Folder of exported runs; None for the tracker.
    out : str or None
        Folder of the report; files of an earlier report there that this one does not write are removed.
    replace : bool, optional
        Whether a report there may be replaced although it shows runs that are not to be had here.
    store : Store
        The tracker.
    workspace : pathlib.Path
        Folder for the files.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        The published values beside the measured ones, and findings.

    Raises
    ------
    InputError
        If a run that is named is not there, or if the folder has a report of runs that are not.
    """
    if isinstance(runs, str):
        raise InputError(f"runs: expected a list of ids, runs=[...], received {runs!r}")
    source = Source(store, None if archive is None else Path(archive).expanduser())
    folder = None if out is None else Path(out).expanduser().absolute()
    if folder is not None and not replace:
        _refuse_to_replace(folder, source)
    families = chosen(source, _studies(), [str(each) for each in runs])
    sections = [section_of(family) for family in progress.track(families, "Reading runs")]
    values = published_table(sections)
    _write(sections, values, source, workspace)
    return Outcome(
        metrics=_counts(sections, values),
        tables=_shown(values),
        findings=tuple(_describe(sections, values, source)),
    )


def _studies() -> list[str]:
    named = [step.study for step in thesis_steps() if step.study]
    return list(dict.fromkeys([*published_values(), *named, *FURTHER]))


def _write(sections: Sequence[Section], values: pd.DataFrame, source: Source, workspace: Path) -> None:
    """Write all files into the workspace."""
    (workspace / TABLES).mkdir()
    (workspace / FIGURES).mkdir()
    origin, jobs = provenance(sections), job_runs(sections)
    captions: dict[str, str] = {}
    published = _table_files(workspace, "published", "Published values and ours", values, "", captions)
    shown, taken = [], {"published", "provenance", "jobs"}
    for section in sections:
        shown.append(_section_files(section, workspace, _stem(section, taken), source, captions))
    places = _table_files(workspace, "provenance", "Where the numbers come from", origin, "", captions)
    every = _table_files(workspace, "jobs", "Runs", jobs, "", captions)
    files.write_text(workspace / TABLES / "report.tex", latex_document(captions))
    made = f"Made by ctus study=report from {counted(len(sections), 'run')} with {counted(len(jobs), 'job')}."
    files.write_text(workspace / PAGE, page(published, shown, places, every, made))
    record = {"runs": [section.run_id for section in sections]}
    files.write_text(workspace / WRITTEN, json.dumps(record, indent=1))


def _section_files(
    section: Section, workspace: Path, stem: str, source: Source, captions: dict[str, str]
) -> ShownSection:
    note = f"Run {section.run_id[:ID_LENGTH]}"
    tables = tuple(
        _table_files(workspace, f"{stem}_{slug(title)}", title, frame, note, captions, section.title)
        for title, frame in section.outcome.tables.items()
        if len(frame)
    )
    figures = []
    for name, figure in section.outcome.figures.items():
        place = f"{FIGURES}/{stem}_{slug(name)}"
        save_figure(figure, workspace / place, FIGURE_FILES)
        png = (workspace / f"{place}.png").read_bytes()
        figures.append(ShownFigure(f"{section.title}, {name.replace('_', ' ')}", place, png))
    run, left = section.family.run, section.left_out
    return ShownSection(
        section.title,
        stem,
        f"Run {section.run_id}, {run.name}; {counted(len(section.results), 'job')}"
        + (f", {left} left out (failed, or folds of an incomplete training)" if left else ""),
        tables,
        tuple(figures),
        tuple(section.outcome.findings),
        dict(_scenes(section, source)),
        section.failure,
    )


def _scenes(section: Section, source: Source) -> Iterator[tuple[str, str]]:
    """The 3-D pages among the files of a section's runs; an archive has none."""
    if source.archive is None:
        for result in section.results:
            path = source.store.artifact(str(result.run_id), SCENE)
            if path is not None:
                yield f"3-D view of run {str(result.run_id)[:ID_LENGTH]}", path.read_text(encoding="utf-8")


def _table_files(
    workspace: Path,
    stem: str,
    title: str,
    frame: pd.DataFrame,
    note: str,
    captions: dict[str, str],
    of: str = "",
) -> ShownTable:
    place = workspace / TABLES / stem
    caption = ", ".join(filter(None, [of, title]))
    files.write_text(place.with_name(f"{stem}.csv"), frame.to_csv(index=False, lineterminator="\n"))
    files.write_text(place.with_name(f"{stem}.md"), markdown({title: frame}))
    full = ". ".join(filter(None, [caption, note]))
    files.write_text(place.with_name(f"{stem}.tex"), latex_table(frame, full, stem))
    captions[stem] = caption
    return ShownTable(title, frame, f"{TABLES}/{stem}", note)


def slug(text: str) -> str:
    """Write a text as a part of a file's name.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    str
        Small letters, digits and underscores.

    Examples
    --------
    >>> slug("To the truth, simulated")
    'to_the_truth_simulated'
    """
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode("ascii")
    return re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_") or "unnamed"


def _stem(section: Section, taken: set[str]) -> str:
    """What the files of a section begin with; two sections never share one."""
    name = slug(" ".join(filter(None, [section.study, section.subject])))
    for further in (section.preset, section.run_id[:ID_LENGTH]):
        if name not in taken:
            break
        name = slug(f"{name} {further}")
    taken.add(name)
    return name


def _refuse_to_replace(out: Path, source: Source) -> None:
    """Refuse a folder whose report shows runs that the source lacks: they could not be shown again."""
    lacking = [run_id for run_id in _runs_of(out) if not source.has(run_id)]
    if lacking:
        raise InputError(
            f"out: expected a folder without a report of other runs, received {out}, whose report shows "
            f"{counted(len(lacking), 'run')} that {source.name} does not have; out=<another folder> keeps that report, "
            "study=import_runs brings exported runs into the tracker, replace=true replaces it"
        )


def _runs_of(out: Path) -> list[str]:
    """The runs that an earlier report in the folder shows; none where there is none that can be read."""
    try:
        found = json.loads((out / WRITTEN).read_text(encoding="utf-8"))["runs"]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    return [str(each) for each in found] if isinstance(found, list) else []


def _counts(sections: Sequence[Section], values: pd.DataFrame) -> dict[str, float]:
    return {
        "sections": float(len(sections)),
        "rows": float(len(values)),
        "rows_without_run": float((values["comparable"] == NOT_MEASURED).sum()),
        "sections_failed": float(sum(bool(section.failure) for section in sections)),
    }


def _describe(sections: Sequence[Section], values: pd.DataFrame, source: Source) -> Iterator[str]:
    missing = values[values["comparable"] == NOT_MEASURED]
    measured = len(values) - len(missing)
    known = values.drop_duplicates(["study", "value", "published", "published_on"])
    shown = counted(len(sections), "run")
    yield f"{measured} measurements beside {len(known)} published values, from {shown} of {source.name}."
    for section in sections:
        if section.failure:
            yield f"{section.title}, run {section.run_id[:ID_LENGTH]}, could not be summed up: {section.failure}"
    for study, rows in missing.groupby("study", sort=False):
        yield f"{study}: {counted(len(rows), 'published value')} without a run; to measure: {rows['command'].iloc[0]}"
    yield f"Open {PAGE}; {TABLES}/report.tex has every table."


def _shown(values: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The rows that were measured."""
    measured = values[values["comparable"] != NOT_MEASURED]
    return {"published values and ours": measured[list(SHOWN)]} if len(measured) else {}
