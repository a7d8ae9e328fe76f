"""The per-case table of the segmentation studies: pooled over jobs, one row a case, in groups that belong together."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from experiments.analysis.variants import varying_choices, with_choices
from experiments.errors import InputError
from experiments.outcome import JobResult
from models.metrics.scoring import CaseScore

if TYPE_CHECKING:
    import pandas as pd

DISTANCES = ("hd95_mm", "hd95_px")
# What a case is, and what tells repeated scores of it apart.
CASE = ("model", "train_dataset", "dataset", "simulated", "group", "case_id")
REPETITION = ("seed", "outer_fold", "fold")
# Parts of a split: the cases that a fold leaves out and scores, and those outside all folds.
OUT_OF_FOLD = "out_of_fold"
SIMULATED = " (simulated)"
# What the name of a network begins with that trainer=smoke trained. It stands in every row, sentence and figure.
SMOKE = "smoke-trained "


def in_part(cases: pd.DataFrame, part: str = OUT_OF_FOLD) -> pd.DataFrame:
    """Select the cases of one part of the split.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table; without a column ``part`` all its cases are out of fold.
    part : str, optional
        ``out_of_fold``, or the name of a part outside all folds.

    Returns
    -------
    pandas.DataFrame
        Rows of that part.
    """
    return cases[cases["part"] == part] if "part" in cases else cases[[part == OUT_OF_FOLD] * len(cases)]


def pool(results: Sequence[JobResult], factors: Sequence[str] = (), part: str = OUT_OF_FOLD) -> pd.DataFrame:
    """Pool the cases of one part of the split over all jobs, named apart by what was chosen for models and data sets.

    Two widths of one network, or one network with two augmentations, become two models (``unet
    model.width=8``, ``unet augmentation=strong``), and two folders or subsets of one kind of data set become
    two data sets (``folder dataset.root=/data/a``), so that their cases are never mixed. Folds and seeds are
    repetitions of one model.

    Parameters
    ----------
    results : sequence of JobResult
        The jobs; those without cases are left out.
    factors : sequence of str, optional
        Settings for which the cases have a column of their own.
    part : str, optional
        Part of the split; cases of several parts are never pooled.

    Returns
    -------
    pandas.DataFrame
        One row for each case of each job.

    Raises
    ------
    InputError
        If no job has cases in that part.
    """
    import pandas as pd

    kept = [
        dataclasses.replace(result, cases=in_part(result.cases, part))
        for result in results
        if result.cases is not None and len(in_part(result.cases, part))
    ]
    if not kept:
        raise InputError(f"results: expected at least one job with cases in {part}, received none")
    kinds = [_kind(_cases(result)) for result in kept]
    varying = varying_choices(kept, kinds, (*REPETITION, *factors))
    return pd.concat(
        [_named(_cases(result), choices) for result, choices in zip(kept, varying, strict=True)],
        ignore_index=True,
    )


def _kind(cases: pd.DataFrame) -> tuple[str, ...]:
    """What a job's cases are called before choices are added: jobs that share it have to be told apart.

    Where each network is tested on several data sets, jobs that share one of them would mix: the model is all.
    """
    names = ["model"] if "train_dataset" in cases else ["model", "dataset"]
    return tuple(cases[names].iloc[0].astype(str))


def _named(cases: pd.DataFrame, choices: Mapping[str, str]) -> pd.DataFrame:
    """The cases with what was chosen for their data set in its name, and everything else in that of the model."""
    of_data = {key: value for key, value in choices.items() if key.split(".")[0] == "dataset"}
    of_model = {key: value for key, value in choices.items() if key not in of_data}
    return cases.assign(
        model=[with_choices(str(name), of_model) for name in cases["model"]],
        dataset=[with_choices(str(name), of_data) for name in cases["dataset"]],
    )


def groups(cases: pd.DataFrame) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Split the cases by model and data set.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table, as ``pool`` gives it.

    Yields
    ------
    tuple[str, str, pandas.DataFrame]
        Model, label of the data set (marked if simulated) and cases of each pair of the two.
    """
    for key, group in cases.groupby(["model", "dataset", "simulated"], sort=False):
        model, dataset, simulated = key
        yield str(model), dataset_label(str(dataset), bool(simulated)), group


def dataset_label(dataset: str, simulated: bool) -> str:
    """Give the name of a data set as tables, figures and findings show it.

    Parameters
    ----------
    dataset : str
        Name of the data set.
    simulated : bool
        Whether it is simulated, which the label says.

    Returns
    -------
    str
        The label.
    """
    return f"{dataset}{SIMULATED}" if simulated else dataset


def place_of(label: str) -> str:
    """Give the name of a data set as metrics have it: without the mark of a simulated one.

    Parameters
    ----------
    label : str
        As ``dataset_label`` gives it.

    Returns
    -------
    str
        The name.
    """
    return label.removesuffix(SIMULATED)


def distances(cases: pd.DataFrame) -> list[str]:
    """List the columns of the penalised HD95 that the cases have: in mm, in px or in both.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table.

    Returns
    -------
    list of str
        Names of the columns that hold a number, mm first.
    """
    return [name for name in DISTANCES if name in cases and cases[name].notna().any()]


def distance(cases: pd.DataFrame) -> str:
    """Give the column of the penalised HD95 in mm if the cases have one, else of that in px.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table.

    Returns
    -------
    str
        Name of the column.
    """
    return next(iter(distances(cases)), DISTANCES[-1])


def scores(cases: pd.DataFrame) -> list[str]:
    """List the columns that hold scores.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table.

    Returns
    -------
    list of str
        Names of the columns.
    """
    return [name for name in CaseScore.__dataclass_fields__ if name in cases]


def is_smoke(cases: pd.DataFrame) -> pd.Series:
    """Mark the rows of networks that ``trainer=smoke`` trained.

    Such a training shows that everything works and not how well a network segments.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table.

    Returns
    -------
    pd.Series
        Truth values by row of ``cases``.
    """
    return cases["model"].astype(str).str.startswith(SMOKE)


def smoke_note(cases: pd.DataFrame) -> tuple[str, ...]:
    """Explain what smoke-trained networks are good for.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table.

    Returns
    -------
    tuple of str
        One sentence; none if there are no such networks.
    """
    if not is_smoke(cases).any():
        return ()
    return (
        "trainer=smoke shows that all works and not how well a network segments: the smoke-trained networks are "
        "compared with nothing.",
    )


def seeds(cases: pd.DataFrame) -> list[object]:
    """List the seeds that the cases were scored with.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table.

    Returns
    -------
    list of object
        Different seeds, ascending; empty if the cases have no such column.
    """
    return sorted(cases["seed"].unique()) if "seed" in cases else []


def once_each(cases: pd.DataFrame) -> pd.DataFrame:
    """Reduce the cases to one row for each case and model: scores of several seeds or folds are averaged.

    A score that is undefined in some repetitions is averaged over the others. ``missed`` and ``false_alarm``
    become the share of repetitions.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table.

    Returns
    -------
    pandas.DataFrame
        The averaged scores; ``cases`` itself if nothing is repeated.

    Raises
    ------
    InputError
        If a network scored a case twice for one seed and fold: two settings under one name.
    """
    keys = [name for name in CASE if name in cases]
    again = cases.duplicated([*keys, *(name for name in REPETITION if name in cases)])
    if again.any():
        row = cases[again].iloc[0]
        raise InputError(
            f"cases: expected each case once for a model, a seed and a fold, received {row['case_id']!r} of "
            f"{row['model']} on {row['dataset']} more than once"
        )
    if not cases.duplicated(keys).any():
        return cases
    return cases.groupby(keys, sort=False, as_index=False, dropna=False)[scores(cases)].mean()


def _cases(result: JobResult) -> pd.DataFrame:
    assert result.cases is not None
    return result.cases
