"""The figures of single trials: boxes where the errors are, failures at the edge, what RMSE hides counted."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
from robustness_rows import FAR, row

from experiments.studies.robustness.error_figures import error_boxes, residual_against_error, runtimes


def medians(axes) -> list[float]:
    return [float(line.get_ydata()[0]) for line in axes.lines if line.get_color() == "black"]


def test_boxes_have_their_medians_by_method_and_overlap_and_failures_at_the_edge() -> None:
    rows = [
        row(method, overlap=overlap, tre_mm=tre, rmse_mm=0.5)
        for method, overlap, errors in (
            ("a", 1.0, (0.1, 0.2, 0.3)),
            ("a", 0.4, (1, 2, 3)),
            ("b", 1.0, (math.inf,) * 3),
        )
        for tre in errors
    ]
    rmse, tre = error_boxes(pd.DataFrame(rows)).axes
    assert medians(tre) == [0.2, 2.0, 1000.0]
    assert medians(rmse) == [0.5, 0.5, 0.5]
    assert (rmse.get_ylabel(), tre.get_ylabel(), tre.get_yscale()) == ("RMSE (mm)", "TRE (mm)", "log")
    assert [label.get_text() for label in tre.get_xticklabels()] == ["1", "0.4"]


def test_each_method_has_its_panel_with_what_rmse_hides() -> None:
    cases = pd.DataFrame(
        [row("a"), row("a", tre_mm=FAR), row("b", tre_mm=FAR, rmse_mm=3.0), row("b", tre_mm=0.0)]
    )
    one, other = residual_against_error(cases).axes
    assert (one.get_title(), other.get_title()) == ("a: RMSE hides 1 of 2", "b: RMSE hides 0 of 2")
    np.testing.assert_allclose(other.collections[-1].get_offsets(), [[FAR, 3.0], [0.01, 0.5]])


def test_panels_beyond_the_last_method_are_hidden(tmp_path: Path) -> None:
    figure = residual_against_error(pd.DataFrame([row(name) for name in "abcd"]))
    assert [axes.get_visible() for axes in figure.axes] == [True] * 4 + [False] * 2
    figure.savefig(tmp_path / "panels.png", dpi=40)


def test_the_median_time_is_written_beside_its_box() -> None:
    cases = pd.DataFrame(
        [row("a", runtime_s=seconds) for seconds in (0.1, 0.25, 3.0)] + [row("b", runtime_s=2.0)]
    )
    axes = runtimes(cases).axes[0]
    assert [text.get_text() for text in axes.texts] == ["0.25 s", "2.00 s"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "b"]
