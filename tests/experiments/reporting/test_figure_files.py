"""Figures as files: names are text, whatever signs they hold."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from experiments.reporting.figure_files import save_figure


@pytest.mark.parametrize("name", ["a$b$c", "cost $5 and $\\\\frac{$", "$x_1$", "one $"])
def test_dollar_signs_are_no_formula(name: str, tmp_path: Path) -> None:
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [1, 2], label=name)
    axes.set(title=name, xlabel=name, xticks=[0, 1])
    axes.set_xticklabels([name, "other"])
    axes.text(0.5, 1.5, name)
    axes.legend(title=name)
    figure.suptitle(name)
    figure.supxlabel(name)
    save_figure(figure, tmp_path / "figure.of.names")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figure.of.names.png", "figure.of.names.svg"]
    # The SVG notes each text as a comment before its outlines: as it is, not as a formula's parts.
    drawn = (tmp_path / "figure.of.names.svg").read_text()
    assert drawn.count(f"<!-- {name} -->") == 8


@pytest.mark.parametrize("scale", ["log", "symlog"])
def test_a_logarithmic_axis_has_plain_numbers(scale: str, tmp_path: Path) -> None:
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    axes.plot([0.02, 300], [1, 2])
    axes.set(xscale=scale, xlim=(0.05, 200))
    save_figure(figure, tmp_path / "figure", ("svg",))
    drawn = (tmp_path / "figure.svg").read_text()
    assert "<!-- 100 -->" in drawn
    assert "mathdefault" not in drawn
