"""Configurations of San Raffaele by name, as the studies that train on them share it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

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
