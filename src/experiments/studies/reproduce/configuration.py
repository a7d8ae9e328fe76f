"""The configuration of a run as it can be run here and now: new settings, paths of this machine, empty caches."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import yaml

from experiments import registry
from experiments.analysis.segmentation.fold_run import device_of
from experiments.errors import InputError, user_errors
from experiments.paths import conf_dir
from experiments.plugins import option_file
from experiments.provenance import COMMIT_TAG
from experiments.running import jobs
from experiments.running.path_settings import named_paths
from experiments.tracking import LABEL_TAG
from experiments.tracking.run_record import RunRecord, config_of

# What an archive has in place of the folders of the machine that a path lay in.
CUT = ".../"
# Settings of the call and not of the study; a run that is run again gets them anew.
_OF_THE_CALL = {"resume": False}
# Jobs of one call whose choices are the same are told apart by the beginning of their hash.
_JOB_HASH = re.compile(r"(?:^|,)job=[0-9a-f]{12}$")


@dataclass(frozen=True)
class Prepared:
    """Configuration of a job that is to be run again.

    Parameters
    ----------
    config : dict
        The configuration, as the runner takes it.
    lacking : tuple of str
        Settings that the run did not have, with today's default: ``name=value``.
    moved : tuple of str
        Paths that are read from another place than they were: ``old -> new``.
    label : str
        Choices of the command line that made the run, as far as its name has them.
    without_gpu : bool, optional
        Whether it was made on a GPU and is run on the CPU, because there is none here.
    """

    config: dict[str, Any]
    lacking: tuple[str, ...]
    moved: tuple[str, ...]
    label: str
    without_gpu: bool = False


def prepared(record: RunRecord, data_root: Path | None) -> Prepared:
    """Make the configuration of a run one that can be run here.

    Parameters
    ----------
    record : RunRecord
        The run.
    data_root : Path or None
        Folder that holds the data; None for the paths as they were.

    Returns
    -------
    Prepared
        The configuration and what was changed in it.

    Raises
    ------
    InputError
        If the run has no configuration, its study or a class that it names no longer exists, it lacks a setting that
        has no plain default, or what it read is not here.
    """
    config = {**configuration_of(record), **_OF_THE_CALL}
    absent: list[str] = []
    try:
        module = jobs.study_module(str(config["study"]))
        lacking = _new_settings(config, module)
        config |= lacking
        inside = _new_fields(config)
        places, absent = _places(config, module, data_root)
        config, without_gpu = _on_this_machine(_replaced(config, places))
        label = _label(record.tags.get(LABEL_TAG, record.name), config)
        jobs.check(config)
    except user_errors() as refusal:
        raise InputError(f"run {record.run_id[:12]}: {_refusal(refusal, record, absent)}") from refusal
    said = tuple(f"{name}={value}" for name, value in lacking.items())
    moved = tuple(f"{old} -> {new}" for old, new in places.items())
    return Prepared(config, (*said, *inside), moved, label, without_gpu)


def configuration_of(record: RunRecord) -> dict[str, Any]:
    """Read the resolved configuration that a run has logged.

    Parameters
    ----------
    record : RunRecord
        The run.

    Returns
    -------
    dict
        The configuration as plain data.

    Raises
    ------
    InputError
        If the run has none, or one that names no study.
    """
    found = config_of(record.config)
    if "study" not in found:
        raise InputError(
            f"run {record.run_id[:12]}: expected a run with a configuration (config.yaml), found none; its files are "
            "not where the tracker says they are, or it was not made by ctus"
        )
    return found


def with_own_caches(node: Any, folder: Path) -> Any:
    """Give every cache in a configuration a new and empty place, so that nothing is taken that was computed before.

    Parameters
    ----------
    node : Any
        A configuration or a part of one.
    folder : Path
        Folder for the caches.

    Returns
    -------
    Any
        The same with other paths under every ``cache``.
    """
    if isinstance(node, Mapping):
        return {
            key: str(folder / PurePath(value).name)
            if key == "cache" and isinstance(value, str)
            else with_own_caches(value, folder)
            for key, value in node.items()
        }
    return [with_own_caches(item, folder) for item in node] if isinstance(node, list) else node


def _new_settings(config: Mapping[str, Any], module: Any) -> dict[str, Any]:
    """Today's defaults of the settings that a study needs and that the configuration lacks."""
    found = {}
    for taker in _takers(module):
        for name, parameter in inspect.signature(taker).parameters.items():
            wanted = name not in jobs.INJECTED and parameter.default is inspect.Parameter.empty
            if wanted and name not in config and name not in found:
                found[name] = _default(str(config["study"]), name)
    return found


def _default(study: str, name: str) -> Any:
    """The value of a setting in the files of configurations, where it is plain there."""
    path = option_file("study", study)
    content = yaml.safe_load(path.read_text(encoding="utf-8")) if path is not None else {}
    general = yaml.safe_load((conf_dir() / "config.yaml").read_text(encoding="utf-8"))
    chosen = {
        str(key).lstrip("/"): option
        for entry in content.get("defaults", [])
        if isinstance(entry, Mapping)
        for key, option in entry.items()
    }
    value = {**general, **content}.get(name, _missing := object())
    if name in chosen:
        option = option_file(name, chosen[name]) if isinstance(chosen[name], str) else None
        # An option that the study changes in part is not plain.
        plain = option is not None and value is _missing
        value = yaml.safe_load(option.read_text(encoding="utf-8")) if option and plain else _missing
    if value is _missing or "${" in str(value) or "???" in str(value) or "'defaults'" in str(value):
        raise InputError(f"it lacks the setting {name}, which is new and has no plain default")
    return value


def _new_fields(node: Any, place: str = "") -> tuple[str, ...]:
    """Settings of the classes in a configuration that it lacks, with their defaults."""
    if isinstance(node, list):
        return tuple(
            said for index, item in enumerate(node) for said in _new_fields(item, f"{place}[{index}]")
        )
    if not isinstance(node, Mapping):
        return ()
    found: tuple[str, ...] = ()
    if "_target_" in node:
        parameters = inspect.signature(registry.load(str(node["_target_"]), place)).parameters
        found = tuple(
            f"{place}.{name}={_shown(parameter.default)}"
            for name, parameter in parameters.items()
            if name not in node and parameter.default is not inspect.Parameter.empty
        )
    for key, value in node.items():
        found += _new_fields(value, f"{place}.{key}" if place else str(key))
    return found


def _shown(default: object) -> str:
    # Of a part that has settings of its own the name is enough.
    return type(default).__name__ if hasattr(default, "__dataclass_fields__") else repr(default)


def _takers(module: Any) -> list[Callable[..., object]]:
    return [getattr(module, name) for name in ("run", "check") if hasattr(module, name)]


def _places(
    config: Mapping[str, Any], module: Any, data_root: Path | None
) -> tuple[dict[str, str], list[str]]:
    """Where each path that a job reads is now, where that is another place, and the paths that are nowhere."""
    places, absent = {}, []
    for path in named_paths(config, _takers(module)).values():
        found = _found(path, data_root)
        if found is None:
            absent.append(path)
        elif found != path:
            places[path] = found
    return places, absent


def _found(path: str, data_root: Path | None) -> str | None:
    parts = [part for part in PurePath(path.removeprefix(CUT)).parts if part != PurePath(path).anchor]
    if data_root is not None:
        for first in range(len(parts)):
            if (inside := data_root.joinpath(*parts[first:])).exists():
                return str(inside)
        if parts and data_root.name == parts[-1] and data_root.exists():
            return str(data_root)
    # A file of the original's own machine is only found by its whole path.
    whole = not path.startswith(CUT)
    return path if whole and Path(path).expanduser().exists() else None


def _on_this_machine(config: dict[str, Any]) -> tuple[dict[str, Any], bool]:
    """The configuration without a GPU where none is here, and whether it had one."""
    trainer = config.get("trainer")
    if not isinstance(trainer, Mapping) or trainer.get("accelerator") != "gpu" or device_of("gpu") != "cpu":
        return config, False
    return {**config, "trainer": {**trainer, "accelerator": "cpu"}}, True


def _replaced(node: Any, places: Mapping[str, str]) -> Any:
    if isinstance(node, Mapping):
        return {key: _replaced(value, places) for key, value in node.items()}
    if isinstance(node, list):
        return [_replaced(item, places) for item in node]
    return places.get(node, node) if isinstance(node, str) else node


def _label(name: str, config: Mapping[str, Any]) -> str:
    """The choices in the name of a run, less what the study itself changes in each job: ``model=unet,fold=0``."""
    found = jobs.job_configs(config)
    own = [change for job, change in found if job == config]
    if len(own) != 1:
        raise InputError(f"expected the configuration of one of {len(found)} jobs, found that of {len(own)}")
    change, word = own[0], _JOB_HASH.sub("", name)
    if word == change or "=" not in word:
        return ""
    return word[: -len(change) - 1] if change and word.endswith(f",{change}") else word


def _refusal(refusal: Exception, record: RunRecord, absent: Sequence[str]) -> str:
    """Why a configuration can't be run here, with what may help."""
    if absent:
        return (
            f"what it read is not here ({', '.join(absent)}); data_root=<the folder that holds it> says where it is. "
            f"{refusal}"
        )
    commit = record.tags.get(COMMIT_TAG, "")
    made = f"; it was made at commit {commit[:12]}" if commit else ""
    return f"this version can't take its configuration{made}: {refusal}"
