"""The sections of a report: which tracked runs it shows, and what their studies make of them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.analysis.pages.page_parts import archived_result
from experiments.errors import InputError
from experiments.masking import masked
from experiments.outcome import JobResult, Outcome
from experiments.reporting.measured import Measured
from experiments.running.jobs import study_module
from experiments.running.run_job import headline_names
from experiments.running.run_names import option, subject
from experiments.tracking import Store
from experiments.tracking.archive import shared
from experiments.tracking.headline import headline
from experiments.tracking.overview import FINISHED, TopRun, top_runs
from experiments.tracking.run_lookup import Family, find_families
from experiments.tracking.run_record import config_of

# Settings that say where files are and what else a call does: no part of what is measured.
OF_THE_CALL = ("call", "out", "resume", "jobs", "launcher", "dry_run", "tracking", "fold")
# Settings that a phantom or a method is named by; they are compared within one section.
WITHIN = ("phantoms", "phantom", "subset")
_PRESET = re.compile(r"\+(?:sweep|preset)=([\w./-]+)")


@dataclass(frozen=True)
class Section:
    """What a report shows of one sweep.

    Parameters
    ----------
    family : Family
        The run with those below it.
    subject : str
        What it is about: a data set, files; empty for phantoms.
    preset : str
        Preset that it was called with; empty without one.
    outcome : Outcome
        Tables, figures and findings of its jobs.
    measured : tuple of Measured
        Values that stand beside published ones.
    results : tuple of JobResult
        The jobs that count.
    left_out : int
        Number of jobs that do not: failed, or folds of a seed that lacks others.
    whole : bool
        Whether no folds are missing of what is shown.
    failure : str
        Why the study made nothing of its jobs; empty if it did.
    """

    family: Family
    subject: str
    preset: str
    outcome: Outcome
    measured: tuple[Measured, ...] = ()
    results: tuple[JobResult, ...] = ()
    left_out: int = 0
    whole: bool = True
    failure: str = ""

    @property
    def study(self) -> str:
        """Name of the study."""
        return self.family.run.experiment

    @property
    def run_id(self) -> str:
        """Id of the topmost run."""
        return self.family.run.run_id

    @property
    def budget(self) -> str:
        """Option of ``trainer=``, of runs that do not say it their epochs; empty where nothing was trained."""
        if not self.results:
            return ""
        config = self.results[0].config
        trainer = config.get("trainer")
        if isinstance(trainer, Mapping) and "trainer" not in config.get("call", {}).get("options", {}):
            return f"{trainer.get('max_epochs', 'unknown')} epochs"
        return option(config, "trainer")

    @property
    def title(self) -> str:
        """Study, subject and preset, as a heading."""
        return ": ".join(filter(None, [self.study.replace("_", " "), self.subject or self.preset]))


@dataclass(frozen=True)
class Source:
    """Where runs are read from.

    Parameters
    ----------
    store : Store
        The tracker.
    archive : Path or None, optional
        Folder of exported runs in its place; None for the tracker.
    """

    store: Store
    archive: Path | None = field(default=None)

    @property
    def name(self) -> str:
        """What the source is, in words."""
        return (
            f"the archive {self.archive}"
            if self.archive is not None
            else f"the store {masked(self.store.address)}"
        )

    def has(self, run_id: str) -> bool:
        """Tell whether a run is there.

        Parameters
        ----------
        run_id : str
            Its whole id.

        Returns
        -------
        bool
            True if it is.
        """
        try:
            find_families([run_id], self.store, self.archive)
        except InputError:
            return False
        return True


def chosen(source: Source, studies: Sequence[str], runs: Sequence[str]) -> list[Family]:
    """Find the runs to show.

    Parameters
    ----------
    source : Source
        Where runs are read from.
    studies : sequence of str
        Names of the studies, in the order of the report.
    runs : sequence of str
        Ids of runs, or the first characters of them; none for the newest sweep of each study, subject and preset.

    Returns
    -------
    list of Family
        Runs with those below them, in the order of the studies.

    Raises
    ------
    InputError
        If a run that is named is not there.
    """
    if runs:
        ids = list(dict.fromkeys(runs))
    else:
        newest: dict[tuple[str, str, str], TopRun] = {}
        for run in top_runs(source.store, source.archive, studies):
            if not run.config:
                continue
            key = (run.experiment, *_kind(run.config))
            if key not in newest or _worth(run) > _worth(newest[key]):
                newest[key] = run
        ordered = sorted(newest.items(), key=lambda item: (studies.index(item[0][0]), item[0][1:]))
        ids = [run.run_id for _, run in ordered]
    found = find_families(ids, source.store, source.archive)
    return [_as_archived(family) for family in {each.run.run_id: each for each in found}.values()]


def _as_archived(family: Family) -> Family:
    """The runs without folders of this machine, so that a report says the same of a store and of its archive."""
    return Family(shared(family.run), tuple(shared(run) for run in family.below))


def _worth(run: TopRun) -> tuple[bool, int]:
    """A sweep that is complete counts more than one that is new, and of the others that with most jobs."""
    done = run.status == FINISHED
    return done, 0 if done else run.finished


def section_of(family: Family) -> Section:
    """Let the study of some runs make tables, figures and findings of them.

    Nothing but configurations, metrics and tables of cases is read, which an archive has as well: the report of an
    archive that was imported elsewhere is the same.

    Parameters
    ----------
    family : Family
        A run with those below it.

    Returns
    -------
    Section
        The section; its ``failure`` says so where the study cannot read runs of an older version.

    Raises
    ------
    InputError
        If no job finished.
    """
    jobs = [run for run in family.jobs if run.status == FINISHED]
    if not jobs:
        raise InputError(
            f"runs: expected a run with a job that finished, found none in {family.run.run_id[:8]}"
        )
    results, whole = whole_seeds([archived_result(run) for run in jobs])
    about, preset = _kind(jobs[0].config)
    left_out = len(family.jobs) - len(results)
    module = study_module(family.run.experiment)
    try:
        outcome = module.summarise(results) if hasattr(module, "summarise") else _metrics_of(results)
        known: Callable[[list[JobResult]], Sequence[Measured]] = getattr(module, "measured", lambda _: ())
        values = tuple(known(results))
    except Exception as failure:  # one sweep of another version must not take the report of all others
        text = f"{type(failure).__name__}: {failure}"
        return Section(family, about, preset, Outcome(), (), tuple(results), left_out, whole, text)
    return Section(family, about, preset, outcome, values, tuple(results), left_out, whole)


def whole_seeds(results: Sequence[JobResult]) -> tuple[list[JobResult], bool]:
    """Keep the folds of those trainings that have all of them: the mean over some folds is that of some groups.

    Parameters
    ----------
    results : sequence of JobResult
        Jobs that finished.

    Returns
    -------
    kept : list of JobResult
        The jobs without folds of incomplete ones; all of them where none is complete.
    whole : bool
        Whether all folds of what is kept are there.
    """
    folds: dict[str, set[int]] = {}
    keys = [_training(result.config) for result in results]
    for result, key in zip(results, keys, strict=True):
        folds.setdefault(key, set()).add(int(result.config.get("fold") or 0))
    kept = [
        result
        for result, key in zip(results, keys, strict=True)
        if len(folds[key]) >= _number_of_folds(result.config)
    ]
    return kept or list(results), bool(kept)


def _number_of_folds(config: Mapping[str, Any]) -> int:
    split = config.get("split")
    folded = isinstance(config.get("fold"), int) and isinstance(split, Mapping)
    return int(split.get("folds") or 1) if folded and isinstance(split, Mapping) else 1


def _training(config: Mapping[str, Any]) -> str:
    kept = {key: value for key, value in config.items() if key not in OF_THE_CALL}
    return json.dumps(kept, sort_keys=True, default=str)


def _metrics_of(results: Sequence[JobResult]) -> Outcome:
    """The chosen metrics of each job as a table, for a study that sums nothing up."""
    import pandas as pd

    rows = []
    for result in results:
        names = headline_names(str(result.config["study"]))
        rows.append({**dict(result.choices), **headline(result.metrics, names)})
    return Outcome(tables={"metrics": pd.DataFrame(rows)})


def _kind(config: str) -> tuple[str, str]:
    """What a run is about, and the preset it was called with."""
    known = config_of(config)
    preset = _PRESET.search(str((known.get("call") or {}).get("command", "")))
    try:
        about = subject(known)
    except (KeyError, TypeError, AttributeError, ValueError, InputError):
        about = ""  # a configuration of another version, which its study cannot read any more
    if about in {option(known, name) for name in WITHIN if known.get(name)}:
        about = ""
    return about, preset.group(1) if preset else ""
