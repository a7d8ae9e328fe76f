"""Configurations of San Raffaele by name, as the studies that train on them share it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from experiments import registry
from experiments.analysis.segmentation.fold_run import fold_jobs
from experiments.datasets.protocol import DataSet
from experiments.datasets.san_raffaele import FULL, PRUNED, SINGLE, SUBSAMPLED, SanRaffaele
from experiments.errors import InputError

# What each configuration changes in the data set.
CONFIGURATIONS: dict[str, dict[str, str]] = {
    "single_session": {"subset": SINGLE},
    "full": {"subset": FULL},
    "pruned": {"subset": PRUNED},
    "full_as_single_session": {"subset": SUBSAMPLED, "subsample_to": SINGLE},
    "full_as_pruned": {"subset": SUBSAMPLED, "subsample_to": PRUNED},
}


def names_of(config: Mapping[str, Any]) -> Sequence[str]:
    """Return the configurations that a sweep point names.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.

    Returns
    -------
    sequence of str
        Names.

    Raises
    ------
    InputError
        If it is no list of any.
    """
    names = config.get("configurations")
    if not isinstance(names, Sequence) or isinstance(names, str) or not names:
        raise InputError(f"configurations: expected a list of configurations, received {names!r}")
    return names


def configuration_jobs(config: Mapping[str, Any], names: Sequence[str]) -> list[dict[str, Any]]:
    """List one job for each configuration and fold, or for the fold that ``fold`` names.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.
    names : sequence of str
        Configurations to train on.

    Returns
    -------
    list of dict
        What each job changes in the configuration.

    Raises
    ------
    InputError
        If a configuration is unknown, the data set has none, or the split has outer folds or is read from a file.
    """
    split = registry.build(config["split"], "split")
    if split.outer_folds is not None or split.file is not None:
        raise InputError("split: expected folds of every configuration alike, received outer_folds or a file")
    dataset = registry.build(config["dataset"], "dataset")
    for name in names:
        configured(dataset, [name])
    folds = fold_jobs(split, None, config["fold"])
    return [{"configurations": [name], **job} for name in names for job in folds]


def configured(dataset: DataSet, configurations: Sequence[str]) -> SanRaffaele:
    """Give the data set in one configuration.

    Parameters
    ----------
    dataset : DataSet
        San Raffaele in any configuration.
    configurations : sequence of str
        Name of one configuration.

    Returns
    -------
    SanRaffaele
        The data set.

    Raises
    ------
    InputError
        If it is another data set, or there is no such configuration.
    """
    if not isinstance(dataset, SanRaffaele):
        raise InputError(f"dataset: expected san_raffaele, which has configurations, received {dataset!r}")
    if len(configurations) != 1 or configurations[0] not in CONFIGURATIONS:
        raise InputError(
            f"configurations: expected each one of {', '.join(CONFIGURATIONS)}, received {list(configurations)}"
        )
    return replace(dataset, **CONFIGURATIONS[configurations[0]])  # type: ignore[arg-type]
