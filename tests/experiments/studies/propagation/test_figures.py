"""The figure: a marker for each sweep and network, failures on a line of their own, numbers in words."""

from __future__ import annotations

import numpy as np
import pandas as pd
from figure_labels import labels
from matplotlib.figure import Figure
from propagation_rows import fail, propagation_rows

from experiments.studies.propagation.comparison import correlations
from experiments.studies.propagation.figures import figures

DSC = {"reference": 1.0, "single_session": 0.7, "full": 0.8, "mine": 0.75}


def drawn(cases: pd.DataFrame) -> Figure:
    return figures(cases, correlations(cases))["propagation"]


def test_each_panel_has_a_marker_for_each_sweep_and_configuration() -> None:
    figure = drawn(propagation_rows(DSC))
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "RMSE of the surface (mm)", "TRE, rigid stage (mm)", "TRE, deformable stage (mm)",
    ]  # fmt: skip
    for axes in figure.axes:
        assert [len(line.get_xdata()) for line in axes.lines] == [8] * 4
        assert len({line.get_color() for line in axes.lines}) == 4
        assert len({line.get_marker() for line in axes.lines}) == 4
        assert "n = 24, 8 vessels" in axes.get_title()
    said = labels(figure)
    assert "Reference masks (n = 8)" in said
    assert "Single session (n = 8)" in said
    assert not [text for text in said if "_" in text]
    assert "not comparable" in figure.get_suptitle()


def test_a_failure_is_drawn_above_all_results_and_counted() -> None:
    (surface, *_) = drawn(fail(propagation_rows(DSC), "full", 1003)).axes
    heights = np.concatenate([line.get_ydata() for line in surface.lines[:4]])
    assert np.isfinite(heights).all()
    full = surface.lines[2]
    assert full.get_ydata()[3] == heights.max() > np.sort(heights)[-2]
    assert full.get_xdata()[3] == 0.0
    assert [text.get_text() for text in surface.texts] == ["No result: 1"]


def test_without_a_deformable_stage_there_is_no_empty_panel() -> None:
    assert len(drawn(propagation_rows(DSC, deformed=False)).axes) == 2
    cases = propagation_rows({"full": 0.8}, vessels=1)
    assert figures(fail(cases, "full", 1000), correlations(cases)) == {}


def test_errors_that_differ_greatly_are_on_a_logarithmic_axis_and_networks_have_markers() -> None:
    cases = propagation_rows(DSC)
    cases.loc[3, "tre_mm"] = 400.0
    axes = drawn(cases).axes[1]
    assert axes.get_yscale() == "log"
    assert [tick.get_text() for tick in axes.get_yticklabels()] == [
        "1",
        "2",
        "5",
        "10",
        "20",
        "50",
        "100",
        "200",
        "500",
    ]
    both = pd.concat([propagation_rows({"full": 0.8}, model=name) for name in ("unet", "attention_unet")])
    said = labels(drawn(both))
    assert {"Full, U-Net (n = 8)", "Full, Attention U-Net (n = 8)"} <= set(said)
