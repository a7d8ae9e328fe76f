"""What runs are called in the dashboard, and which settings it has columns for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from experiments.running.config_hash import NEVER_PART, NOT_PART_OF_THE_JOB
from experiments.running.job_names import choices_of
from experiments.running.jobs import Job, study_module
from experiments.running.path_settings import named_paths
from experiments.tracking.names import flatten

# Jobs that differ in these alone repeat one thing.
REPETITIONS = ("fold", "outer_fold", "training_seed", "seed")
# Groups whose options are what is compared, in the order in which they name a run.
METHODS = ("model", "rigid", "deformable")
# Settings that say what something is measured on.
SUBJECTS = ("dataset", "first", "second", "moving", "fixed", "target", "phantoms", "phantom", "subset")
# As many columns as a person reads.
MOST_PARAMETERS = 14
MOST_NAMED = 4
MOST_LISTED = 8
MOST_MAIN = 6
_SINGULAR = {
    name: name[:-1] for name in ("overlaps", "places", "rotations", "phantoms", "factors", "configurations")
}
_OTHER_NAMES = {"trainer": "budget"}
_NO_OPTION = frozenset({"study", "none", "default"})
_NOTHING = frozenset({"", "none", "None", "null", "[]", "{}", "False"})
# Settings that say where files are or how many processes read them, and no more of the result.
_NO_PARAMETER = frozenset({"study", "call", "out", "model_path", *NOT_PART_OF_THE_JOB, *NEVER_PART})


def choices(job: Job) -> dict[str, str]:
    """The settings by which a job differs from the others of its call.

    Parameters
    ----------
    job : Job
        The job.

    Returns
    -------
    dict[str, str]
        Values by setting, as the command line has them.
    """
    return {name.lstrip("+"): value for name, value in choices_of(job.label).items()}


def option(config: Mapping[str, Any], group: str) -> str:
    """The option that was chosen of a group; of methods by name all of them.

    Parameters
    ----------
    config : Mapping[str, Any]
        Resolved configuration.
    group : str
        Name of the setting that the group fills.

    Returns
    -------
    str
        Name of the option; empty where there is none.
    """
    value = config.get(group)
    if isinstance(value, Mapping) and "_target_" not in value:
        return ", ".join(str(name) for name in value)
    chosen = config.get("call", {}).get("options", {}).get(group)
    if chosen is not None:
        return str(chosen)
    if isinstance(value, Mapping):
        return str(value["_target_"]).rsplit(".", 1)[-1]
    return "" if value is None else _plain(value)


def subject(config: Mapping[str, Any]) -> str:
    """Name what a run is about: its data set, its files, its phantom.

    Parameters
    ----------
    config : Mapping[str, Any]
        Resolved configuration.

    Returns
    -------
    str
        The name; empty where there is none.
    """
    # A study of which a job does not use the data set says so.
    used = _of_study(config).get("dataset") != ""
    if isinstance(dataset := config.get("dataset"), Mapping) and used:
        simulated = " (simulated)" if dataset.get("simulate") is True else ""
        return f"{option(config, 'dataset')}{simulated}"
    if isinstance(config.get("first"), Mapping) and isinstance(config.get("second"), Mapping):
        return f"{option(config, 'first')} and {option(config, 'second')}"
    files = _files(config)
    if {"moving", "fixed"} <= files.keys():
        return f"{files['moving']} to {files['fixed']}"
    if files:
        return ", ".join(list(files.values())[:2])
    others = [name for name in SUBJECTS if config.get(name) and (used or name != "dataset")]
    return next((option(config, name) for name in others), "")


def thing(job: Job) -> str:
    """Name what is compared: the method, and whatever else tells it from others but folds and seeds.

    Parameters
    ----------
    job : Job
        The job.

    Returns
    -------
    str
        The name; empty where nothing is compared.
    """
    parts = [_methods(job)] if _methods(job) else []
    named = _of_study(job.config)
    if isinstance(trained_on := job.config.get("train_on"), str) and trained_on in job.config:
        parts.append(f"trained on {option(job.config, trained_on)}")
    for name, value in choices(job).items():
        if name not in (*REPETITIONS, *METHODS, *SUBJECTS, "train_on"):
            shown = named.get(_short(name), value)
            parts += [f"{_short(name)} {_plain(shown)}"] if str(shown) not in _NOTHING else []
    return ", ".join(parts)


def job_name(job: Job, *, with_subject: bool) -> str:
    """Name the run of a job.

    Parameters
    ----------
    job : Job
        The job.
    with_subject : bool
        Whether the name says what the run is about, which that of a run above may say already.

    Returns
    -------
    str
        The name, such as ``usgra, unet`` or ``fold 0 of unet``.
    """
    repeats = [f"{name} {value}" for name, value in choices(job).items() if name in REPETITIONS]
    parts = [subject(job.config) if with_subject else "", thing(job)]
    # A narrow column shows the beginning of a name alone.
    of = [", ".join(part for part in parts if part)]
    return " of ".join(part for part in [", ".join(repeats), *of] if part) or str(job.config["study"])


def sweep_name(jobs: Sequence[Job]) -> str:
    """Name the run above several jobs.

    Parameters
    ----------
    jobs : Sequence[Job]
        The jobs.

    Returns
    -------
    str
        What they are about and what is compared, such as ``usgra: unet, attention_unet``.
    """
    subjects = _joined(dict.fromkeys(subject(job.config) for job in jobs))
    methods = dict.fromkeys(_methods(job) for job in jobs)
    varying = dict.fromkeys(
        _short(name)
        for job in jobs
        for name in choices(job)
        if name not in (*REPETITIONS, *METHODS, *SUBJECTS)
        and len({choices(other).get(name) for other in jobs}) > 1
    )
    things = _joined(methods) + (f" by {', '.join(varying)}" if varying else "")
    return ": ".join(part for part in (subjects, things.strip()) if part) or str(jobs[0].config["study"])


def parameters(job: Job) -> dict[str, str]:
    """Choose the settings that the dashboard has columns for; the configuration holds all.

    These are what the study names (its function ``parameters``), the options of its groups, folds and seeds, what the
    command line set, and the first of the study's own settings.

    Parameters
    ----------
    job : Job
        The job.

    Returns
    -------
    dict[str, str]
        At most ``MOST_PARAMETERS`` values by short name.
    """
    config, call = job.config, job.config.get("call", {})
    flat = {name: value for name, value in flatten(config).items() if not name.startswith("call.")}
    varying, groups = choices(job), {*call.get("options", {}), *METHODS}
    ordered = sorted(groups, key=[*METHODS, *SUBJECTS, *call.get("options", {})].index)
    chosen = {group: option(config, group) for group in ordered}
    found: dict[str, Any] = {
        _OTHER_NAMES.get(group, group): value
        for group, value in chosen.items()
        if group not in _NO_OPTION and (value not in _NO_OPTION or group in varying)
    }
    found |= {name: flat[name] for name in REPETITIONS if flat.get(name) is not None}
    found |= _of_study(config)
    asked = {**varying, **{name: flat.get(name) for name in call.get("settings", ())}}
    for name, value in {**{name: flat.get(name, value) for name, value in asked.items()}, **config}.items():
        if name not in groups and name.split(".")[0] not in _NO_PARAMETER and not isinstance(value, Mapping):
            found.setdefault(_short(name), value)
    shown = {name: _plain(value) for name, value in found.items() if str(value) not in _NOTHING}
    return dict(list(shown.items())[:MOST_PARAMETERS])


def _of_study(config: Mapping[str, Any]) -> dict[str, Any]:
    """What the study itself has columns for, by its function ``parameters``."""
    module = study_module(str(config["study"]))
    return dict(module.parameters(config)) if hasattr(module, "parameters") else {}


def main_parameters(jobs: Sequence[Job]) -> list[str]:
    """Choose the parameters that tell the jobs of a call apart, but for folds and seeds, and what they are about.

    Parameters
    ----------
    jobs : sequence of Job
        All jobs of the call.

    Returns
    -------
    list of str
        At most ``MOST_MAIN`` names.
    """
    each = [parameters(job) for job in jobs]
    names = dict.fromkeys(name for one in each for name in one)
    chosen = [name for name in (*METHODS, *SUBJECTS) if name in names]
    # What some jobs lack, such as the place of a piece, tells them apart as well.
    chosen += [name for name in names if len({one.get(name) for one in each}) > 1 and name not in REPETITIONS]
    return list(dict.fromkeys(chosen))[:MOST_MAIN]


def shared_parameters(each: Sequence[Mapping[str, str]], *, listed: bool) -> dict[str, str]:
    """The parameters of several jobs together.

    Parameters
    ----------
    each : Sequence[Mapping[str, str]]
        Parameters of each job.
    listed : bool
        Whether few values that differ are listed; else they are left out, as folds and seeds always are.

    Returns
    -------
    dict[str, str]
        Values by short name.
    """
    values = {name: dict.fromkeys(one[name] for one in each if name in one) for one in each for name in one}
    everywhere = {name for name in values if all(name in one for one in each)}
    return {
        name: ", ".join(found)
        for name, found in values.items()
        if (len(found) == 1 and name in everywhere)
        or (listed and 1 < len(found) <= MOST_LISTED and name not in REPETITIONS)
    }


def _files(config: Mapping[str, Any]) -> dict[str, str]:
    """The names of the files that the study's own settings name, in their order."""
    module = study_module(str(config["study"]))
    takers = [getattr(module, name) for name in ("run", "check") if hasattr(module, name)]
    found = named_paths(config, takers)
    return {
        name: PurePath(path).name or path
        for name, path in found.items()
        if "." not in name and name.split("[")[0] not in ("model_path", "model_paths", "archive")
    }


def _methods(job: Job) -> str:
    named = _of_study(job.config)
    values = (_plain(named.get(name, option(job.config, name))) for name in METHODS)
    return " + ".join(value for value in values if value and value != "none")


def _joined(names: Mapping[str, None]) -> str:
    kept = [name for name in names if name]
    more = f" and {len(kept) - MOST_NAMED} more" if len(kept) > MOST_NAMED else ""
    return ", ".join(kept[:MOST_NAMED]) + more


def _short(name: str) -> str:
    """The last part of a dotted name, in the singular where it holds one value of a list a job."""
    last = name.rsplit(".", 1)[-1]
    return _SINGULAR.get(last, last)


def _plain(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(_plain(item) for item in value)
    text = str(value)
    return PurePath(text).name or text if "/" in text and " " not in text else text
