"""The axes that the figures share."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from experiments.studies.robustness.style import draw_rates, legend_above, log_axis, piece_title


def test_rates_have_wilson_s_interval_on_both_sides() -> None:
    axes = Figure().subplots()
    draw_rates(axes, [1.0, 2.0], [60, 30], [60, 60], label="a")
    (bars,) = axes.containers[0].lines[2]
    ends = np.array([segment[:, 1] for segment in bars.get_segments()])
    assert ends[0] == pytest.approx([0.940, 1.0], abs=1e-3)
    assert ends[1] == pytest.approx([0.377, 0.623], abs=1e-3)


@pytest.mark.parametrize("last, ticks", [(3.0, ["0.2", "0.5", "1", "2"]), (300.0, ["1", "10", "100"])])
def test_numbers_on_logarithmic_axes_are_plain(last: float, ticks: list[str]) -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.set_ylim(0.15, last)
    log_axis(axes, "y")
    figure.canvas.draw()
    assert set(ticks) <= {label.get_text() for label in axes.get_yticklabels()}


def test_a_legend_names_each_method_once_and_stays_within_the_figure() -> None:
    figure = Figure(figsize=(4, 3), layout="constrained")
    for axes in figure.subplots(1, 2):
        for name in "abcdef":
            axes.plot([0], [0], label=name)
    legend_above(figure, figure.axes[0])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list("abcdef")
    figure.canvas.draw()
    box = figure.legends[0].get_window_extent()
    assert box.x0 >= 0 and box.x1 <= figure.bbox.width


def test_pieces_are_named_by_overlap_and_place() -> None:
    assert (piece_title(1.0, "whole"), piece_title(0.4, "end")) == ("Overlap 1", "Overlap 0.4, end")
