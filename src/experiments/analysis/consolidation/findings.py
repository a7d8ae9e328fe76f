"""What the consolidation study found, in sentences."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.consolidation.candidates import ENSEMBLE
from experiments.analysis.consolidation.certificate import Certificate

if TYPE_CHECKING:
    import pandas as pd


def describe_certificate(certificate: Certificate, where: str) -> str:
    """State which model was chosen and why.

    Parameters
    ----------
    certificate : Certificate
        The decision.
    where : str
        Network, data set and outer fold.

    Returns
    -------
    str
        The sentence.
    """
    return (
        f"{where}: the consolidated model is the {certificate.consolidated} ({certificate.groups} selection groups, "
        f"{certificate.images} images, {certificate.seeds} seed{'s' if certificate.seeds != 1 else ''}): "
        f"{certificate.reason}"
    )


def describe_candidates(table: pd.DataFrame) -> Iterator[str]:
    """State how the candidates did on test groups next to the ensemble of folds.

    Parameters
    ----------
    table : pandas.DataFrame
        As ``candidates_table`` gives it.

    Yields
    ------
    str
        One sentence for each network and data set.
    """
    for (network, dataset), part in table.groupby(["network", "dataset"], sort=False):
        rows = {str(row["model"]): row for row in part.to_dict("records")}
        base = rows.pop(ENSEMBLE)
        words = ", ".join(f"{name} {_signed(row, 'difference')}" for name, row in rows.items())
        yield (
            f"{network} on {dataset}, {int(base['groups'])} test groups: {ENSEMBLE} DSC {base['dsc_mean']:.3f} "
            f"({base['false_alarms']:.1f} of {int(base['empty'])} empty frames with a false alarm); difference to it: "
            f"{words}."
        )


def describe_ablation(table: pd.DataFrame) -> Iterator[str]:
    """State what each step from probabilities to masks adds on test groups.

    Parameters
    ----------
    table : pandas.DataFrame
        As ``ablation_table`` gives it.

    Yields
    ------
    str
        One sentence for each network, data set and candidate.
    """
    for (network, dataset, model), part in table.groupby(["network", "dataset", "model"], sort=False):
        rows = part.to_dict("records")
        words = ", ".join(f"{row['step']} {_signed(row, 'gain')}" for row in rows[1:])
        yield f"{network} on {dataset}, {model}: DSC {rows[0]['dsc_mean']:.3f} at {rows[0]['step']}; gains: {words}."


def describe_calibration(table: pd.DataFrame, calibration: str, names: tuple[str, ...]) -> Iterator[str]:
    """State what calibration does near the boundary on test groups.

    Parameters
    ----------
    table : pandas.DataFrame
        As ``calibration_table`` gives it.
    calibration : str
        The calibration that is compared with none.
    names : tuple of str
        Candidates to speak of.

    Yields
    ------
    str
        One sentence for each network, data set and candidate.
    """
    keys = ["network", "dataset", "model"]
    for (network, dataset, model), part in table.groupby(keys, sort=False):
        rows = {str(row["calibration"]): row for row in part.to_dict("records")}
        if model in names and calibration in rows:
            before, after = (rows[each]["ece_boundary"] for each in ("none", calibration))
            yield (
                f"{network} on {dataset}, {model}: ECE near the boundary {before:.3f} before and {after:.3f} after "
                f"{calibration.replace('_', ' + ')}, on test groups."
            )


def describe_barriers(table: pd.DataFrame) -> Iterator[str]:
    """State how high the barriers between the folds' networks are.

    Parameters
    ----------
    table : pandas.DataFrame
        As ``barrier_table`` gives it.

    Yields
    ------
    str
        One sentence for each network and data set.
    """
    for (network, dataset), part in table.groupby(["network", "dataset"], sort=False):
        fall, rise = (part[f"{name}_barrier_mean"].mean() for name in ("dsc", "loss"))
        yield (
            f"{network} on {dataset}: on the straight line between the weights of two folds the DSC falls by "
            f"{fall:.3f} and the loss rises by {rise:.3f} (mean of {len(part)} "
            f"pair{'s' if len(part) != 1 else ''}, selection groups)."
        )


def _signed(row: Mapping[Hashable, Any], name: str) -> str:
    bounds = row[f"{name}_ci_low"], row[f"{name}_ci_high"]
    # A gain of exactly nothing is said to be that.
    value = f"{row[name]:+.3f}" if abs(row[name]) >= 5e-4 else "0.000"
    return value if np.isnan(bounds[0]) else f"{value} ({bounds[0]:+.3f} to {bounds[1]:+.3f})"
