"""From a resolved configuration to the jobs in it: those that the study names."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from experiments import registry
from experiments.errors import InputError, user_errors
from experiments.files import write_text
from experiments.paths import project_root
from experiments.plugins import options_of, study_packages
from experiments.running.config_hash import config_hash
from experiments.running.content_hash import content_digest
from experiments.running.job_names import choices_of, distinct_labels, folder_names
from experiments.running.path_settings import named_paths
from models.value_types import mismatch, parameter_types

# What the sweep runner hands to a study in addition to its configuration.
INJECTED = frozenset({"workspace", "progress", "store"})


@dataclass(frozen=True)
class Job:
    """One job: its whole configuration, its hash, and a short label that tells it from its neighbours.

    ``choices`` are the words of the command line by which its sweep point differs from others.

    Parameters
    ----------
    config : dict[str, Any]
        Its resolved configuration.
    hash : str
        Hash of what it computes.
    label : str
        What tells it from the other jobs of the call.
    choices : dict[str, str], optional
        Settings by which its sweep point differs from others.
    """

    config: dict[str, Any]
    hash: str
    label: str
    choices: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Plan:
    """All jobs of one call of the command line, by hash, and the runs that they have in the tracker.

    ``contents`` are the digests of all that the jobs read, as they were when the call began.

    Parameters
    ----------
    study : str
        Name of the study.
    labels : dict[str, str]
        Label of every job by its hash.
    out : str
        Folder for the results of the call.
    contents : dict[str, str], optional
        Digest of what the jobs read, by path.
    names : dict[str, str], optional
        Name of the run of every job by its hash.
    parents : dict[str, str], optional
        Id of the run right above that of a job, by the job's hash.
    levels : dict[str, str], optional
        Place of a job's run among those of the call, by the job's hash: a result or the repeat of one.
    """

    study: str
    labels: dict[str, str]
    out: str
    contents: dict[str, str] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    parents: dict[str, str] = field(default_factory=dict)
    levels: dict[str, str] = field(default_factory=dict)

    def folder_of(self, key: str) -> Path:
        """Where the job of that hash leaves its files: in ``out`` itself if it is alone, else in a folder there.

        Parameters
        ----------
        key : str
            The job's hash.

        Returns
        -------
        Path
            The folder.
        """
        out = Path(self.out)
        return out if len(self.labels) == 1 else out / folder_names(self.labels)[key]

    def write(self, folder: Path) -> None:
        """Write the plan as JSON, for the processes that a launcher starts.

        Parameters
        ----------
        folder : Path
            The folder of the plan.
        """
        write_text(folder / "plan.json", json.dumps(asdict(self)))

    @staticmethod
    def read(folder: Path) -> Plan:
        """Read what ``write`` wrote.

        Parameters
        ----------
        folder : Path
            The folder of the plan.

        Returns
        -------
        Plan
            The plan.
        """
        return Plan(**json.loads((folder / "plan.json").read_text(encoding="utf-8")))


def study_names() -> list[str]:
    """List the studies there are, by their configurations.

    Returns
    -------
    list of str
        Names, sorted, those of plugins among them.
    """
    return options_of("study")


def study_module(name: str) -> ModuleType:
    """Import the module of a study.

    Parameters
    ----------
    name : str
        Name of the study, which is that of its module in ``experiments.studies`` or in a plugin's ``studies``.

    Returns
    -------
    ModuleType
        The module, or the package that hands its functions on.

    Raises
    ------
    InputError
        If there is no such study.
    """
    for package in study_packages() if name.isidentifier() else ():
        if _is_module(package, name):
            return importlib.import_module(f"{package}.{name}")
    raise InputError(f"study: expected one of {', '.join(study_names())}, received {name!r}")


def _is_module(package: str, name: str) -> bool:
    full = f"{package}.{name}"
    try:
        return full in sys.modules or importlib.util.find_spec(full) is not None
    except ModuleNotFoundError as missing:  # a plugin need not have studies
        if missing.name == package:
            return False
        raise


def job_configs(config: Mapping[str, Any]) -> list[tuple[dict[str, Any], str]]:
    """The configuration of every job of one point of a sweep, and the label of what sets it apart.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.

    Returns
    -------
    list[tuple[dict[str, Any], str]]
        Configuration and label of each job.
    """
    module = study_module(config["study"])
    with _settings_there(config):
        changes = module.jobs(config) if hasattr(module, "jobs") else [{}]
    if not changes:
        raise InputError(f"study={config['study']}: expected at least one job, the configuration names none")
    return [
        ({**config, **change}, ",".join(f"{k}={_short(v)}" for k, v in change.items())) for change in changes
    ]


def arguments(config: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of the study's ``run`` that come from the configuration, with every ``_target_`` built.

    Raises InputError where the configuration has no value for one, or a class refuses its settings.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.

    Returns
    -------
    dict[str, Any]
        Arguments by name.
    """
    return _arguments(study_module(config["study"]).run, config)


def check(config: Mapping[str, Any]) -> None:
    """Raise InputError for what can be known to be wrong before any job starts.

    A study that reads files has a function ``check``, whose parameters are settings as those of ``run`` are.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.
    """
    with naming_settings(config):
        arguments(config)
        module = study_module(config["study"])
        if hasattr(module, "check"):
            module.check(**_arguments(module.check, config))


def check_points(points: list[tuple[Mapping[str, Any], str]]) -> None:
    """Check every job of every sweep point, before any file is read for its digest.

    So a mistake is found at once, however large the data is.

    Parameters
    ----------
    points : list[tuple[Mapping[str, Any], str]]
        Resolved configuration and label of each sweep point.

    Raises
    ------
    InputError
        If a job is known to be wrong before it starts.
    """
    first: dict[str, dict[str, Any]] = {}
    for config, _ in points:
        for job, _ in job_configs(config):
            first.setdefault(config_hash(job, {}), job)  # the job that runs, of several that are the same
    for job in first.values():
        read_paths(job)  # an empty path is refused by its setting's name
        check(job)


def _arguments(function: Callable[..., object], config: Mapping[str, Any]) -> dict[str, Any]:
    parameters = inspect.signature(function).parameters
    wanted = [name for name in parameters if name not in INJECTED]
    missing = [
        name for name in wanted if name not in config and parameters[name].default is inspect.Parameter.empty
    ]
    if missing:
        raise InputError(f"study={config['study']}: expected a value for {', '.join(missing)}, received none")
    built = {name: registry.build(config[name], name) for name in wanted if name in config}
    types = parameter_types(function)
    for name, value in built.items():
        if (wrong := mismatch(name, value, types.get(name, Any))) is not None:
            raise InputError(wrong)
    return built


def jobs_of(points: list[tuple[Mapping[str, Any], str]], contents: dict[str, str] | None = None) -> list[Job]:
    """Every job of every sweep point (its configuration and label), each once, with labels that are all different.

    ``contents`` are digests of paths that are known already; those of further paths are added to it.

    Parameters
    ----------
    points : list[tuple[Mapping[str, Any], str]]
        Resolved configuration and label of each sweep point.
    contents : dict[str, str] or None, optional
        Digests that are known already, by path; further ones are added.

    Returns
    -------
    list[Job]
        The jobs, each once.
    """
    known = {} if contents is None else contents
    jobs: dict[str, Job] = {}
    for config, label in points:
        for job, change in job_configs(config):
            key = config_hash(job, _contents_of(job, known))
            jobs.setdefault(key, Job(job, key, ",".join(filter(None, (label, change))), choices_of(label)))
    labels = distinct_labels({key: job.label for key, job in jobs.items()})
    return [replace(job, label=labels[key]) for key, job in jobs.items()]


def hash_now(config: Mapping[str, Any]) -> str:
    """The hash of a job by what it would read at this moment.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.

    Returns
    -------
    str
        The hash in hexadecimal.
    """
    return config_hash(config, _contents_of(config, {}))


def read_paths(config: Mapping[str, Any]) -> list[str]:
    """Every path that a job reads: what its settings name, and what its study reads in addition.

    A study that reads files which no setting names has a function ``implicit_paths`` that yields them for a
    configuration.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.

    Returns
    -------
    list[str]
        Paths as the configuration has them.
    """
    module = study_module(config["study"])
    named = list(_named_paths(config).values())
    if not hasattr(module, "implicit_paths"):
        return named
    with _settings_there(config):
        return named + [str(path) for path in module.implicit_paths(config)]


def _named_paths(config: Mapping[str, Any]) -> dict[str, str]:
    module = study_module(config["study"])
    return named_paths(config, [getattr(module, name) for name in ("run", "check") if hasattr(module, name)])


@contextmanager
def naming_settings(config: Mapping[str, Any]) -> Iterator[None]:
    """Put the setting before a refusal that begins with the path which that setting names.

    Readers know the file alone; who has two of one kind has to know which setting to mend.

    Parameters
    ----------
    config : Mapping[str, Any]
        The configuration of the job that is checked or run.

    Raises
    ------
    InputError
        In place of such a refusal.
    """
    try:
        yield
    except user_errors() as refusal:
        for setting, path in _named_paths(config).items():
            begins = {f"{path}:", f"{Path(path).expanduser()}:"} if path else set()
            if str(refusal).startswith(tuple(begins)):
                raise InputError(f"{setting}: {refusal}") from refusal
        raise


@contextmanager
def _settings_there(config: Mapping[str, Any]) -> Iterator[None]:
    """Name the setting that a study looks up and that was taken out of the configuration (``~setting``)."""
    try:
        yield
    except KeyError as error:
        name = error.args[0] if error.args else None
        if not isinstance(name, str) or name in config:
            raise
        raise InputError(f"study={config['study']}: expected a value for {name}, received none") from error


def _contents_of(config: Mapping[str, Any], known: dict[str, str]) -> dict[str, str]:
    """The digest of what lies under each path of a job; ``known`` ones are taken, the others added to it."""
    paths = read_paths(config)
    # What this project writes is nobody's input only because it lies inside a folder that is.
    written = [project_root() / name for name in ("outputs", "mlruns", ".cache/plans")]
    written += [Path(str(config["out"])).expanduser()] if config.get("out") else []
    for path in paths:
        if path not in known:
            known[path] = content_digest(Path(path).expanduser(), written)
    return {path: known[path] for path in paths}


def out_folder(config: Mapping[str, Any], key: str) -> Path:
    """Where results go: ``out`` as the user gave it (from the current folder), else a folder of the study's own.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.
    key : str
        The job's hash.

    Returns
    -------
    Path
        The folder.
    """
    if config.get("out"):
        return Path(str(config["out"])).expanduser().absolute()
    return project_root() / "outputs" / str(config["study"]) / key[:12]


def _short(value: Any) -> str:
    if isinstance(value, Mapping):
        return "+".join(str(key) for key in value) or "none"
    if isinstance(value, (list, tuple)):
        return "+".join(_short(item) for item in value)
    return str(value)
