"""Distinct names for the rows of several jobs: a name with the choices by which the jobs' points of a sweep differ."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Hashable, Mapping, Sequence
from pathlib import Path, PurePath

from experiments.outcome import JobResult
from experiments.running.config_hash import NEVER_PART, NOT_PART_OF_THE_JOB, job_config
from experiments.tracking.names import flatten

# What stands for the choices of jobs that no command line made.
SETTINGS = "settings"
MAX_SETTINGS = 3


def varying_choices(
    results: Sequence[JobResult], names: Sequence[Hashable], excluded: Collection[str] = ()
) -> list[dict[str, str]]:
    """Find for each job the choices that vary among the jobs of its name, as the command line has them.

    Jobs without any choices have the settings in which they differ instead, or a digest of these if there are
    more than ``MAX_SETTINGS``.

    Parameters
    ----------
    results : sequence of JobResult
        The jobs.
    names : sequence of Hashable
        Name of each job.
    excluded : Collection[str], optional
        Settings that the rows have columns for, such as folds; they are left out of the names.

    Returns
    -------
    list of dict
        For each job the value of every varying choice, by its name.
    """
    choices = [_choices(result, excluded) for result in results]
    found = []
    for name, own in zip(names, choices, strict=True):
        others = [other for kind, other in zip(names, choices, strict=True) if kind == name]
        found.append({key: value for key, value in own.items() if any(o.get(key) != value for o in others)})
    settings = [{} if result.choices else _settings(result, excluded) for result in results]
    for name, own, mine in zip(names, found, settings, strict=True):
        alike = [other for kind, other in zip(names, settings, strict=True) if kind == name]
        differing = {key: value for key, value in mine.items() if any(o.get(key) != value for o in alike)}
        own |= differing if len(differing) <= MAX_SETTINGS else {SETTINGS: _digest(differing)}
    return found


def with_choices(name: str, choices: Mapping[str, str]) -> str:
    """Add choices to a name, so that it differs from others: ``unet augmentation=strong``.

    Parameters
    ----------
    name : str
        Name of a row.
    choices : Mapping[str, str]
        Value of each choice, by its name.

    Returns
    -------
    str
        The name, followed by the choices.
    """
    return " ".join([name, *(f"{key}={value}" for key, value in choices.items())])


def distinct_names(
    results: Sequence[JobResult], names: Sequence[str], excluded: Collection[str] = ()
) -> list[str]:
    """Name each job with the choices that vary among the jobs of its name.

    Parameters
    ----------
    results : sequence of JobResult
        The jobs.
    names : sequence of str
        Name of each job.
    excluded : Collection[str], optional
        Settings that the rows have columns for, such as folds; they are left out of the names.

    Returns
    -------
    list of str
        Name with choices, one for each job.
    """
    varying = varying_choices(results, names, excluded)
    return [with_choices(name, choices) for name, choices in zip(names, varying, strict=True)]


def names_of_files(paths: Sequence[str]) -> list[str]:
    """Shorten paths to names that are still unique.

    Parameters
    ----------
    paths : sequence of str
        Different files, as the user wrote their paths.

    Returns
    -------
    list of str
        For each file its stem, with as much of its suffix and path as no other file has.
    """
    whole = {path: PurePath(Path(path).expanduser().absolute()) for path in paths}
    names = {path: file.stem for path, file in whole.items()}
    for depth in range(1, max((len(file.parts) for file in whole.values()), default=0) + 1):
        shared = [path for path, name in names.items() if list(names.values()).count(name) > 1]
        # Files of one name get their suffixes first, then by the folders around them.
        names |= {path: "/".join(whole[path].parts[-depth:]) for path in shared}
    return [names[path] for path in paths]


def _choices(result: JobResult, excluded: Collection[str]) -> dict[str, str]:
    left_out = {*excluded, *NOT_PART_OF_THE_JOB}
    return {
        name: value
        for name, value in result.choices.items()
        if name not in left_out
        and name.split(".")[0] not in left_out
        and name.rsplit(".", 1)[-1] not in NEVER_PART
    }


def _settings(result: JobResult, excluded: Collection[str]) -> dict[str, str]:
    """The settings of a job but for those that have columns of their own."""
    left_out = {*excluded, *NEVER_PART}
    return {
        name: str(value)
        for name, value in flatten(job_config(result.config)).items()
        if name not in excluded
        and name.rsplit(".", 1)[-1] not in left_out
        and name.split(".")[0] not in excluded
    }


def _digest(settings: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:6]
