"""Published values beside measured ones: in range or by how much not, comparable or why not, and the command."""

from __future__ import annotations

import math

import pytest
from run_families import alone

from experiments.outcome import JobResult, Outcome
from experiments.reporting.measured import SIMULATED, Measured
from experiments.reporting.published import published_values
from experiments.studies.report.published_table import NOT_MEASURED, number_text, published_table
from experiments.studies.report.sections import Section


def section(
    *measured: Measured, study: str = "segmentation", whole: bool = True, trainer: str = "cpu"
) -> Section:
    family = alone("abcdef123456", None, experiment=study, tags={"ctus.command": "ctus study=mine"})
    config = {"call": {"options": {"trainer": trainer}}, "trainer": {"_target_": "x.Y"}}
    return Section(
        family, "", "", Outcome(), measured, (JobResult(config, {}, None, family_path()),), whole=whole
    )


def family_path():  # type: ignore[no-untyped-def]
    from pathlib import Path

    return Path()


def test_without_runs_every_value_names_its_command() -> None:
    table = published_table([])
    assert len(table) == sum(map(len, published_values().values()))
    assert set(table["comparable"]) == {NOT_MEASURED}
    assert (table["command"].str.startswith("ctus ")).all()
    assert (table[["ours", "run"]] == "").all(axis=None)


@pytest.mark.parametrize(
    ("value", "difference"),
    [(0.91, "in range"), (0.9389, "+0.9 %"), (0.85, "-4.0 %"), (math.nan, "")],
)
def test_a_value_lies_in_the_range_or_so_far_from_it(value: float, difference: str) -> None:
    table = published_table([section(Measured("dsc", "unet on carotid", value, 0.9, 0.95, 5, "groups"))])
    (row,) = table[table["run"] != ""].to_dict("records")
    assert row["difference"] == difference
    assert (row["interval"], row["n"], row["comparable"]) == ("90.0 % to 95.0 %", "5 groups", "yes")
    assert (row["run"], row["budget"], row["command"]) == ("abcdef12", "cpu", "ctus study=mine")
    # The other values of the study still say how to measure them.
    assert (table.loc[table["run"] == "", "comparable"] == NOT_MEASURED).all()


def test_what_stands_in_the_way_of_a_comparison_is_told() -> None:
    smoke = section(Measured("dsc", "a", 0.9, not_comparable=SIMULATED), whole=False, trainer="smoke")
    table = published_table([smoke, section(Measured("total_s", "vein", math.inf), study="runtime")])
    (row,) = table[table["study"].eq("segmentation") & table["run"].ne("")].to_dict("records")
    assert row["comparable"] == (
        "simulated, not comparable; folds missing; trainer=smoke: shows that all works, no result"
    )
    (row,) = table[table["study"].eq("runtime") & table["run"].ne("")].to_dict("records")
    assert (row["ours"], row["difference"]) == ("inf s", "+inf s")


def test_numbers_have_the_unit_of_the_published_value() -> None:
    assert [number_text(0.934, "%"), number_text(0.5, "mm"), number_text(16.54, "s"), number_text(2.0, "")] == [
        "93.4 %", "0.50 mm", "16.5 s", "2.000",
    ]  # fmt: skip
    assert number_text(math.nan, "mm") == ""
