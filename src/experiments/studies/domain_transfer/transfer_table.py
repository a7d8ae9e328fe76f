"""What a network trained on one data set is worth on another: the table of train and test domain, and its figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.segmentation.case_table import dataset_label, is_smoke, once_each
from experiments.errors import InputError
from experiments.reporting.labels import axis_label, method_label
from experiments.statistics import Bootstrap, PairedComparison, PairedResult, by_unit, holm

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


# Of the table, which has them also where no case tested on has a vessel.
COLUMNS = (
    "model",
    "trained_on",
    "tested_on",
    "groups",
    "cases",
    "dsc_mean",
    "dsc_ci_low",
    "dsc_ci_high",
    "missed_rate",
)


def transfer_table(cases: pd.DataFrame) -> pd.DataFrame:
    """Tabulate the mean DSC with its bootstrap 95 % interval over groups, by model, train and test data set.

    A case scored by the networks of several folds or seeds is averaged over these first. ``trained_on`` is
    marked where simulated: by the column ``train_simulated``, or as the test cases of that data set are.

    Parameters
    ----------
    cases : pandas.DataFrame
        Scored cases, with ``train_dataset`` next to ``dataset``, the one tested on.

    Returns
    -------
    pandas.DataFrame
        One row per model, train and test data set, with the columns ``COLUMNS``.

    Raises
    ------
    InputError
        If ``cases`` does not say what was trained on, or whether that is simulated.
    """
    import pandas as pd

    if "train_dataset" not in cases:
        raise InputError("cases: expected a column 'train_dataset', received none")
    simulated = _simulated(cases)
    rows = []
    for key, part in cases.groupby(["model", "train_dataset", "dataset", "simulated"], sort=False):
        model, trained, tested, marked = key
        each = once_each(part).dropna(subset="dsc")
        if not len(each):
            continue
        dsc = Bootstrap("mean_of_cases")(each["dsc"], each["group"].tolist())
        rows.append(
            {
                "model": str(model),
                "trained_on": dataset_label(str(trained), simulated[str(trained)]),
                "tested_on": dataset_label(str(tested), bool(marked)),
                "groups": dsc.units,
                "cases": len(each),
                "dsc_mean": dsc.estimate,
                "dsc_ci_low": dsc.low,
                "dsc_ci_high": dsc.high,
                "missed_rate": float(each["missed"].mean()),
            }
        )
    return pd.DataFrame(rows, columns=list(COLUMNS))


def describe_transfer(cases: pd.DataFrame) -> tuple[str, ...]:
    """State what training on another data set costs.

    Each model and test set is compared with training on the same data set. The same cases are scored by both
    networks, so that groups are compared in pairs (see ``PairedComparison``); the p-values are adjusted for
    all sentences together. There is no sentence on networks that ``trainer=smoke`` trained.

    Parameters
    ----------
    cases : pandas.DataFrame
        Scored cases, with ``train_dataset`` next to ``dataset``, the one tested on.

    Returns
    -------
    tuple of str
        Sentences.
    """
    simulated, compared = _simulated(cases), []
    for key, part in cases[~is_smoke(cases)].groupby(["model", "dataset", "simulated"], sort=False):
        model, tested, marked = key
        home = part[part["train_dataset"] == tested]
        for trained, away in part[part["train_dataset"] != tested].groupby("train_dataset", sort=False):
            both = set(home["case_id"]) & set(away["case_id"])
            own, foreign = (
                by_unit(once_each(side[side["case_id"].isin(both)]), "dsc") for side in (home, away)
            )
            if len(own):
                place = f"{model} tested on {dataset_label(str(tested), bool(marked))}"
                label = dataset_label(str(trained), simulated[str(trained)])
                compared.append((place, label, PairedComparison()(foreign, own)))
    adjusted = holm([found.test.p for *_, found in compared])
    return tuple(
        _sentence(place, label, found, float(p))
        for (place, label, found), p in zip(compared, adjusted, strict=True)
    )


def _sentence(place: str, trained_on: str, found: PairedResult, p_holm: float) -> str:
    change, test = found.mean_difference, found.test
    bounds = "" if np.isnan(change.low) else f" (95 % interval {change.low:+.3f} to {change.high:+.3f})"
    return (
        f"{place}: mean DSC over {found.units} groups {found.first.estimate:.3f} when trained on {trained_on}, "
        f"{found.second.estimate:.3f} when trained on the same data set (groups not seen); mean difference "
        f"{change.estimate:+.3f}{bounds}, p = {test.p:.2g}, with Holm's adjustment {p_holm:.2g}, least possible "
        f"p {test.min_attainable_p:.2g}."
    )


def transfer_map(table: pd.DataFrame) -> Figure:
    """Draw the table as a map for each model.

    Parameters
    ----------
    table : pandas.DataFrame
        Table that ``transfer_table`` returns, with at least one row.

    Returns
    -------
    Figure
        Rows trained on, columns tested on, mean DSC with interval in each field.
    """
    from matplotlib.figure import Figure

    models = list(dict.fromkeys(table["model"]))
    trained, tested = (list(dict.fromkeys(table[name])) for name in ("trained_on", "tested_on"))
    # One order on both sides puts training and testing on the same data set on the diagonal.
    tested.sort(key=lambda name: trained.index(name) if name in trained else len(trained))
    size = (1.6 + len(models) * (1.0 + 1.5 * len(tested)), 1.6 + 1.1 * len(trained))
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(1, len(models), squeeze=False)[0]
    for axes, model in zip(grid, models, strict=True):
        rows = table[table["model"] == model].set_index(["trained_on", "tested_on"])
        fields = rows["dsc_mean"].to_dict()
        means = np.array([[fields.get((one, other), np.nan) for other in tested] for one in trained])
        image = axes.imshow(means, cmap="viridis", vmin=0, vmax=1)
        for (place, tested_place), mean in np.ndenumerate(means):
            if not np.isnan(mean):
                row = rows.loc[(trained[place], tested[tested_place])]
                text = f"{mean:.3f}\n{_bounds(row)}\n{row['groups']:.0f} groups"
                colour = "black" if mean > 0.6 else "white"
                axes.text(tested_place, place, text, ha="center", va="center", color=colour, fontsize="small")
        axes.set_xticks(range(len(tested)), [_broken(name) for name in tested])
        axes.set_yticks(range(len(trained)), [_broken(name) for name in trained])
        axes.set(title=method_label(model), xlabel="Tested on", ylabel="Trained on")
    figure.colorbar(image, ax=list(grid), label=axis_label("dsc"))
    figure.suptitle("Mean DSC over cases, 95 % interval over groups", fontsize="medium")
    return figure


def _bounds(row: pd.Series[Any]) -> str:
    return "" if np.isnan(row["dsc_ci_low"]) else f"{row['dsc_ci_low']:.3f} to {row['dsc_ci_high']:.3f}"


def _broken(name: str) -> str:
    return name.replace(" (", "\n(")


def _simulated(cases: pd.DataFrame) -> dict[str, bool]:
    """Whether each data set trained on is simulated."""
    known = {str(name): bool(value) for name, value in cases.groupby("dataset")["simulated"].any().items()}
    if "train_simulated" in cases:
        of_training = cases.groupby("train_dataset")["train_simulated"].any()
        known |= {str(name): bool(value) for name, value in of_training.items()}
    unknown = set(cases["train_dataset"].astype(str)) - set(known)
    if unknown:
        raise InputError(
            f"train_simulated: expected whether {sorted(unknown)[0]!r} is simulated, for it is not among the data sets "
            f"tested on, received no such column"
        )
    return known
