"""Figures name quantities and methods in plain words, and a method looks the same in all of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from figure_labels import labels
from robustness_rows import many

from experiments.reporting.labels import (
    COLOURS,
    LABELS,
    METHODS,
    UNITS,
    axis_label,
    method_label,
    method_styles,
)
from experiments.studies.robustness.rate_figures import figures


@pytest.mark.parametrize(
    "column, expected",
    [
        ("angle_deg", "Rotation (deg)"),
        ("tre_mm", "TRE (mm)"),
        ("success_tre_rate", "Success rate, TRE <= 2 mm"),
        ("success_rate", "Success rate, RMSE <= 1 mm"),
        ("wall_gap_mm", "Wall gap (mm)"),
        ("some_thing_new", "Some thing new"),
        ("mm", "Mm"),
    ],
)
def test_columns_are_named_in_plain_words_with_their_unit(column: str, expected: str) -> None:
    assert axis_label(column) == expected


def test_the_table_itself_has_no_underscore_and_keeps_each_unit() -> None:
    for column, label in LABELS.items():
        assert "_" not in label
        words, _, unit = column.rpartition("_")
        shown = f"(1/{unit.replace('2', '²')})" if words.endswith("_per") else f"({unit})"
        assert unit not in UNITS or label.endswith(shown), column
    assert not [label for label in METHODS.values() if "_" in label]
    assert len(set(METHODS.values())) == len(METHODS)


def test_every_method_that_a_configuration_offers_has_its_name(repository: Path) -> None:
    offered = {
        path.stem
        for folder in ("rigid", "deformable", "model")
        for path in (repository / "conf" / folder).glob("*.yaml")
    }
    assert offered - {"none"} == set(METHODS)


def test_a_method_of_one_s_own_keeps_its_name() -> None:
    assert (method_label("gicp"), method_label("my_method")) == ("GICP", "my method")


def test_a_method_looks_the_same_whatever_it_is_drawn_with() -> None:
    alone = method_styles(["gicp"])["gicp"]
    assert alone == method_styles(["toy", "single_icp", "gicp", "multistart"])["gicp"]


@pytest.mark.parametrize(
    "names", [list(METHODS)[:8], ["multistart", *list(METHODS)[8:14]], [str(number) for number in range(8)]]
)
def test_methods_look_different_by_colour_and_by_marker(names: list[str]) -> None:
    looks = method_styles(names)
    for part in ("color", "marker"):
        assert len({look[part] for look in looks.values()}) == len(names)


def test_methods_of_all_kinds_in_one_figure_still_look_different() -> None:
    looks = method_styles(list(METHODS)[:14])
    assert len({(look["color"], look["marker"]) for look in looks.values()}) == 14


def test_a_method_without_a_look_takes_a_colour_that_is_free() -> None:
    looks = method_styles(["toy", "multistart"])
    assert looks["multistart"]["color"] == COLOURS[0] != looks["toy"]["color"]


def test_no_figure_of_the_robustness_study_has_a_column_or_an_option_for_a_label() -> None:
    for name, figure in figures(many(["multistart", "fpfh_ransac", "my_method"], trials=2)).items():
        assert labels(figure), name
        assert not [text for text in labels(figure) if "_" in text], name
