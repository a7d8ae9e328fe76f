"""Two numbers of a deformable method varied: where the residual is least, and where the true error is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.reporting.labels import COLOURS, axis_label
from experiments.studies.accuracy.sweeps import DEFORMABLE
from registration.rigid.result import length_mm

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def setting_means(cases: pd.DataFrame, parameters: Sequence[str]) -> pd.DataFrame:
    """Average residual and true error over phantoms and sweeps for each pair of settings.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of sweeps and stages.
    parameters : sequence of str
        Columns with the two settings.

    Returns
    -------
    pandas.DataFrame
        A row for each pair of values; a mean is infinite where a sweep failed.
    """
    own = cases[cases["stage"] == DEFORMABLE]
    values = ["rmse_mm", "hd95_mm", "tre_mm", "tre_covered_mm"]
    means = own.groupby(list(parameters), sort=True)[values].mean()
    return means.join(own.groupby(list(parameters)).size().rename("sweeps")).reset_index()


def least(means: pd.DataFrame, parameters: Sequence[str]) -> tuple[str, ...]:
    """State where the least residual and the least true error are.

    Parameters
    ----------
    means : pandas.DataFrame
        Means by pairs of settings.
    parameters : sequence of str
        Columns with the two settings.

    Returns
    -------
    tuple of str
        One sentence; none where every setting failed somewhere.
    """
    finite = means[np.isfinite(means["tre_mm"])]
    if finite.empty:
        return ("Every setting failed on some sweep.",)

    def at(name: str) -> tuple[Any, str]:
        row = finite.loc[finite[name].idxmin()]
        return row, ", ".join(f"{each} {row[each]:g}" for each in parameters)

    (fit, where), (best, there) = at("rmse_mm"), at("tre_mm")
    return (
        f"The least RMSE, {fit['rmse_mm']:.2f} mm, is at {where}, with a true error of {length_mm(fit['tre_mm'])}; the "
        f"least true error, {length_mm(best['tre_mm'])}, is at {there}, with an RMSE of {best['rmse_mm']:.2f} mm.",
    )


def setting_figure(means: pd.DataFrame, parameters: Sequence[str]) -> Figure:
    """Draw heat maps of residual and true error over two settings, with the least of each marked in both.

    Parameters
    ----------
    means : pandas.DataFrame
        A row for each pair of values: the settings, ``rmse_mm`` and ``tre_mm``.
    parameters : sequence of str
        Names of the two settings.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    from matplotlib.figure import Figure

    first, second = parameters
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    figure.suptitle(
        f"Residual and true error by setting, means over {int(means['sweeps'].max())} simulated sweeps"
    )
    tables = {
        name: means.pivot_table(index=first, columns=second, values=name) for name in ("rmse_mm", "tre_mm")
    }
    for axes, (name, table) in zip(figure.subplots(1, 2), tables.items(), strict=True):
        image = axes.imshow(table.to_numpy(dtype=np.float64), cmap="viridis_r", aspect="auto", origin="lower")
        figure.colorbar(image, ax=axes, label=axis_label(name))
        values = table.to_numpy(dtype=np.float64)
        for row, column in np.argwhere(np.isfinite(values)):
            said = f"{values[row, column]:.2f}"
            # Light cells are those of small values.
            colour = "black" if image.norm(values[row, column]) < 0.5 else "white"
            axes.text(column, row, said, ha="center", va="center", color=colour, fontsize=8)
        for other, marker in (("rmse_mm", "s"), ("tre_mm", "o")):
            values = tables[other].to_numpy()
            if np.isfinite(values).any():
                row, column = np.unravel_index(np.nanargmin(values), values.shape)
                axes.plot(
                    column, row, marker, markersize=26, markerfacecolor="none", markeredgecolor=COLOURS[1],
                    markeredgewidth=2, label=f"Least {axis_label(other).split(' (')[0]}", linestyle="none",
                )  # fmt: skip
        axes.set_xticks(range(table.shape[1]), [f"{value:g}" for value in table.columns])
        axes.set_yticks(range(table.shape[0]), [f"{value:g}" for value in table.index])
        axes.set_xlabel(axis_label(second))
        axes.set_ylabel(axis_label(first))
        axes.set_title(axis_label(name))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, markerscale=0.4)
    return figure
