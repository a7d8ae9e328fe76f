"""The words of a figure that a reader takes for names of quantities and methods."""

from __future__ import annotations

from matplotlib.figure import Figure


def labels(figure: Figure) -> list[str]:
    """All labels of axes, of the whole figure and of legends, colour bars' included."""
    found = [figure.get_supxlabel(), figure.get_supylabel()]
    legends = list(figure.legends)
    for axes in figure.axes:
        found += [axes.get_xlabel(), axes.get_ylabel()]
        legends += [legend] if (legend := axes.get_legend()) else []
    return [text for text in found if text] + [
        entry.get_text() for legend in legends for entry in legend.get_texts()
    ]
