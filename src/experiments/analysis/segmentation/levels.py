"""Models compared over the levels of a factor: what they were trained on, or which vessel they segment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from experiments.analysis.segmentation.case_table import SMOKE, is_smoke
from experiments.analysis.segmentation.comparison import compare_models
from experiments.analysis.segmentation.summary import bounded_summary
from experiments.analysis.segmentation.tables import in_words, intervals
from experiments.datasets.protocol import read_notes
from experiments.outcome import JobResult
from experiments.reporting.measured import SIMULATED
from experiments.reporting.published import Published

if TYPE_CHECKING:
    import pandas as pd

# Gives the published values that stand next to a model's, for a level of each factor.
PublishedOf = Callable[[Mapping[str, str]], Sequence[Published]]


def levels(cases: pd.DataFrame, factors: Sequence[str]) -> Iterator[tuple[dict[str, str], str, pd.DataFrame]]:
    """Split the cases by the levels of factors and by model.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table with a column for each factor.
    factors : sequence of str
        Names of the columns.

    Yields
    ------
    tuple[dict, str, pandas.DataFrame]
        Level of each factor, model and cases, in the order of the table.
    """
    for key, part in cases.groupby([*factors, "model"], sort=False):
        yield dict(zip(factors, map(str, key[:-1]), strict=True)), str(key[-1]), part


def with_data_choices(cases: pd.DataFrame) -> pd.DataFrame:
    """Add what was chosen for the data set to the names of models: the levels of a factor tell only its parts apart.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table, as ``pool`` gives it.

    Returns
    -------
    pandas.DataFrame
        The cases; ``unet dataset.substitute.strength=0.5`` where a choice of the data set varies.
    """
    choices = [str(name).partition(" dataset.")[1:] for name in cases["dataset"]]
    return cases.assign(
        model=[f"{model}{''.join(of)}" for model, of in zip(cases["model"], choices, strict=True)]
    )


def levels_table(
    cases: pd.DataFrame, factors: Sequence[str], published_of: PublishedOf, data: str = ""
) -> pd.DataFrame:
    """Tabulate DSC and HD95 with 95 % intervals over groups by the levels of factors and by model.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table with a column for each factor. Repeated scores of a case are averaged.
    factors : sequence of str
        Names of the columns.
    published_of : callable
        Gives the published values of a level of each factor and a ``model``.
    data : str, optional
        What a reader must know of data that are not simulated.

    Returns
    -------
    pandas.DataFrame
        Texts, one row for each level and model; the last column says of simulated data that they are not
        comparable.
    """
    import pandas as pd

    rows = []
    for level, model, part in levels(cases, factors):
        # Parts of a data set that belong to one level are one row.
        numbers = intervals(part.assign(dataset="")).assign(**level)
        row = in_words(numbers, (*factors, "model", "groups"))[[*factors, "model", "groups", "dsc", "hd95"]]
        known = published_of(level | {"model": plain_name(model)})
        rows.append(
            row.assign(
                missed=[f"{100 * rate:.1f} %" for rate in numbers["missed_rate"]],
                published="; ".join(value.text_with_unit for value in known),
                data=SIMULATED if part["simulated"].all() else data,
            )
        )
    return pd.concat(rows, ignore_index=True)


def levels_metrics(cases: pd.DataFrame, factors: Sequence[str]) -> dict[str, float]:
    """Summarise every level and model.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table with a column for each factor.
    factors : sequence of str
        Names of the columns.

    Returns
    -------
    dict
        Scalars under ``<level>/.../<model>/<metric>``.
    """
    found: dict[str, float] = {}
    for level, model, part in levels(cases, factors):
        place = "/".join([*level.values(), model])
        numbers = bounded_summary(part.assign(dataset=""))
        found |= {f"{place}/{name}": value for name, value in numbers.items()}
    return found


def compare_levels(cases: pd.DataFrame, factor: str, place: str, within: Sequence[str] = ()) -> pd.DataFrame:
    """Compare every pair of levels of a factor on the same cases, each model for itself, by groups.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table with a column for the factor.
    factor : str
        Name of that column.
    place : str
        Name of the cases, for sentences.
    within : sequence of str, optional
        Columns whose levels are kept apart, as models are.

    Returns
    -------
    pandas.DataFrame
        As ``compare_models`` gives it; its models are the levels, and its data set names the cases, what is kept
        apart and the model. Only cases that all levels scored are compared; networks that ``trainer=smoke`` trained
        are compared with nothing.
    """
    kept = cases[~is_smoke(cases)]
    places = [", ".join([place, *map(str, row)]) for row in kept[[*within, "model"]].to_numpy()]
    return compare_models(kept.assign(model=kept[factor].astype(str), dataset=places))


def notes_once(results: Sequence[JobResult]) -> tuple[str, ...]:
    """Read the notes of the jobs' data sets, each once: parts of one data set have most of them alike.

    Parameters
    ----------
    results : sequence of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    tuple of str
        Sentences.
    """
    return tuple(dict.fromkeys(note for result in results for note in read_notes([result.workspace])))


def plain_name(model: str) -> str:
    """Give the name of a network without the mark of a smoke training and without the choices behind it.

    Parameters
    ----------
    model : str
        Name as a per-case table has it.

    Returns
    -------
    str
        Name of the network's option.

    Examples
    --------
    >>> plain_name("smoke-trained unet model.width=8")
    'unet'
    """
    return model.removeprefix(SMOKE).split(" ")[0]


def data_label(cases: pd.DataFrame) -> str:
    """Give the name of the data of a per-case table for the title of a figure.

    Parameters
    ----------
    cases : pandas.DataFrame
        Per-case table.

    Returns
    -------
    str
        ``simulated, not comparable`` in brackets where they are simulated; empty otherwise.
    """
    return f" ({SIMULATED})" if cases["simulated"].all() else ""
