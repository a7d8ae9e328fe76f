"""Which launcher a configuration asks for: ``launcher`` says where jobs run, ``jobs`` how many at a time here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from experiments.errors import InputError, did_you_mean
from experiments.running import array_task, sent_arrays, slurm_queue
from experiments.running.jobs import Job
from experiments.running.launcher import InProcess, Launcher
from experiments.running.local_processes import LocalProcesses
from experiments.running.slurm_launcher import SlurmLauncher
from experiments.running.slurm_settings import SlurmSettings
from models.errors import InputError as ModelsInputError
from models.value_types import require_settings

KINDS = ("local", "slurm")


def require_known(config: Mapping[str, Any]) -> None:
    """Refuse settings of a launcher that are none, before anything else of a call is looked at.

    Parameters
    ----------
    config : mapping
        A resolved configuration.

    Raises
    ------
    InputError
        If ``jobs`` is not a whole number from 1, or ``launcher`` is of no kind or has settings that its kind has not.
    """
    jobs_at_once(config)
    if _kind(config) == "slurm":
        slurm_settings(config)
    elif more := sorted(set(_launcher(config)) - {"kind"}):
        raise InputError(f"launcher.{more[0]}: expected no settings of launcher=local, received one")


def launcher_of(config: Mapping[str, Any], planned: Sequence[Job]) -> Launcher:
    """Choose how the jobs of a call are started.

    Parameters
    ----------
    config : mapping
        A resolved configuration.
    planned : sequence of Job
        Jobs of the call.

    Returns
    -------
    Launcher
        ``SlurmLauncher`` where it is asked for; else ``LocalProcesses`` if more than one job may run at a time, else
        ``InProcess``.

    Raises
    ------
    InputError
        If there is no Slurm, or jobs of the call are in its queue.
    """
    by_slurm = _kind(config) == "slurm"
    if by_slurm:
        slurm_queue.require_slurm()
        array_task.require_submitit()
    sent_arrays.require_free(planned, waits=by_slurm and bool(config.get("resume")))
    if by_slurm:
        return SlurmLauncher(slurm_settings(config))
    number = at_once(config, planned)
    return LocalProcesses(number) if number > 1 else InProcess()


def at_once(config: Mapping[str, Any], planned: Sequence[Job]) -> int:
    """How many jobs of a call run at the same time, at most.

    Parameters
    ----------
    config : mapping
        A resolved configuration.
    planned : sequence of Job
        Jobs of the call.

    Returns
    -------
    int
        Number of jobs, from 1.
    """
    if _kind(config) == "slurm":
        settings = slurm_settings(config)
        return min(settings.array_parallelism, settings.array_size, len(planned))
    return min(jobs_at_once(config), len(planned))


def jobs_at_once(config: Mapping[str, Any]) -> int:
    """How many jobs of a call run at the same time on this machine; InputError if ``jobs`` is no whole number from 1.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.

    Returns
    -------
    int
        Number of jobs.
    """
    number = config.get("jobs", 1)
    if isinstance(number, bool) or not isinstance(number, int) or number < 1:
        raise InputError(f"jobs: expected a whole number from 1, received {number!r}")
    if number > 1 and _kind(config) == "slurm":
        raise InputError(
            "jobs: expected 1 with launcher=slurm, whose launcher.array_parallelism says how many jobs run at the "
            f"same time, received {number}"
        )
    return number


def slurm_settings(config: Mapping[str, Any]) -> SlurmSettings:
    """Build what the jobs of a call ask Slurm for.

    Parameters
    ----------
    config : mapping
        A resolved configuration.

    Returns
    -------
    SlurmSettings
        The settings.

    Raises
    ------
    InputError
        If one is unknown, of another type or out of range.
    """
    settings = {str(name): value for name, value in _launcher(config).items() if name != "kind"}
    try:
        require_settings(SlurmSettings, settings, "launcher")
    except ModelsInputError as refusal:
        raise InputError(str(refusal)) from refusal
    return SlurmSettings(**settings)


def _kind(config: Mapping[str, Any]) -> str:
    kind = _launcher(config).get("kind")
    if kind not in KINDS:
        hint = did_you_mean(str(kind), KINDS)
        raise InputError(f"launcher.kind: expected one of {', '.join(KINDS)}, received {kind!r}{hint}")
    return str(kind)


def _launcher(config: Mapping[str, Any]) -> Mapping[str, Any]:
    # Runs of earlier versions have none.
    launcher = config.get("launcher", {"kind": "local"})
    if not isinstance(launcher, Mapping):
        raise InputError(f"launcher: expected settings of a launcher, received {launcher!r}")
    return launcher
