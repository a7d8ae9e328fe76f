"""Rates, tables and doubts of a benchmark, counted by hand from rows written by hand."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd
import pytest

from experiments.analysis.registration.benchmark.figures import benchmark_figures
from experiments.analysis.registration.benchmark.findings import describe_benchmark
from experiments.analysis.registration.benchmark.metrics import (
    benchmark_metrics,
    over_cautious,
    success_interval,
)
from experiments.analysis.registration.benchmark.tables import benchmark_tables

NAN = math.nan


def row(case: str, tre_mm: float, verdict: str = "accepted", **change: Any) -> dict[str, Any]:
    anatomy, kind = case.split("_")
    made = {
        "method": "mine", "case": case, "anatomy": anatomy, "kind": kind, "symmetric": False, "rmse_mm": 0.2,
        "tre_mm": tre_mm, "tre_max_mm": tre_mm, "tre_symmetric_mm": tre_mm, "rotation_error_deg": 0.0,
        "translation_error_mm": tre_mm, "success": True, "success_tre": tre_mm <= 2,
        "success_tre_symmetric": tre_mm <= 2, "verdict": verdict, "ambiguity_gap": NAN, "tre_high_mm": NAN,
        "covered_by_interval": NAN, "second_pose_gap": NAN, "second_tre_mm": NAN, "ambiguous_rightly": NAN,
        "runtime_s": 0.5, "error": "", "simulated": True, "block": "undeformed", "same_vessel": True,
        "tre_rigid_mm": tre_mm, "lowest_tre_mm": 0.0, "high_over_error": NAN,
    }  # fmt: skip
    return made | change


MINE = pd.DataFrame(
    [
        row("a_whole", 0.5, tre_high_mm=0.9, ambiguity_gap=9.0, covered_by_interval=1.0),
        row("a_piece", 1.0, tre_high_mm=1.2, ambiguity_gap=4.0, covered_by_interval=1.0),
        row("b_whole", 7.0, tre_high_mm=1.0, ambiguity_gap=3.0, covered_by_interval=0.0),
        row("b_piece", 9.0, "ambiguous", tre_high_mm=9.5, ambiguity_gap=0.5, covered_by_interval=1.0,
            second_pose_gap=0.3, second_tre_mm=9.0, ambiguous_rightly=1.0),
        row("c_whole", 0.4, "ambiguous", tre_high_mm=3.0, ambiguity_gap=1.0, covered_by_interval=1.0,
            second_pose_gap=6.0, second_tre_mm=4.0, ambiguous_rightly=0.0),
        row("c_piece", math.inf, "failed", error="lost", rmse_mm=math.inf, success=False),
    ]
)  # fmt: skip
OTHER = MINE.assign(
    method="other",
    success_tre_symmetric=[False, False, True, False, False, False],
    verdict="not judged",
    tre_high_mm=NAN,
    ambiguity_gap=NAN,
    covered_by_interval=NAN,
    ambiguous_rightly=NAN,
    error="",
)


def test_rates_are_counted_as_the_specification_has_them() -> None:
    found = benchmark_metrics(MINE)
    assert found["success_tre_rate"] == pytest.approx(3 / 6)
    assert found["acceptance_rate"] == pytest.approx(3 / 6)
    assert found["success_accepted_rate"] == pytest.approx(2 / 3)
    # Wilson, z = 1.95996, 2 of 3: worked out apart.
    assert found["success_accepted_rate_low"] == pytest.approx(0.2077, abs=1e-4)
    assert found["success_accepted_rate_high"] == pytest.approx(0.9385, abs=1e-4)
    assert found["interval_coverage_rate"] == pytest.approx(4 / 5)
    assert found["interval_coverage_accepted_rate"] == pytest.approx(2 / 3)
    assert found["ambiguous_rightly_rate"] == pytest.approx(1 / 2)
    assert (found["accepted_failures"], found["over_cautious"], found["cases_without_result"]) == (1, 1, 1)
    assert found["tre_mm_mean"] == math.inf
    assert found["runtime_s_median"] == 0.5


def test_the_areas_are_those_of_the_orders() -> None:
    found = benchmark_metrics(MINE)
    # By the predicted error: right, wrong, right, right, wrong, wrong (the one without a prediction last).
    assert found["risk_area_tre_high_mm"] == pytest.approx((0 + 1 / 2 + 1 / 3 + 1 / 4 + 2 / 5 + 3 / 6) / 6)
    # By the gap: right, right, wrong, right, wrong, wrong.
    assert found["risk_area_ambiguity_gap"] == pytest.approx((0 + 0 + 1 / 3 + 1 / 4 + 2 / 5 + 3 / 6) / 6)


def test_a_right_result_doubted_without_a_second_pose_is_over_cautious() -> None:
    assert over_cautious(MINE)["case"].tolist() == ["c_whole"]


def test_the_anatomy_is_the_unit_of_the_interval() -> None:
    interval = success_interval(MINE)
    assert interval.units == 3
    assert interval.estimate == pytest.approx(0.5)
    assert interval.low < 0.5 < interval.high


def test_tables_list_what_was_accepted_wrongly_and_what_was_not_accepted() -> None:
    tables = benchmark_tables(pd.concat([MINE, OTHER], ignore_index=True))
    assert tables["accepted wrongly, simulated"]["case"].tolist() == ["b_whole"]
    assert tables["not accepted, simulated"]["case"].tolist() == ["b_piece", "c_whole", "c_piece"]
    methods = tables["methods, simulated"].set_index("method")
    assert methods.loc["mine", "success_tre_rate"] == pytest.approx(0.5)
    assert methods.loc["other", "success_tre_rate"] == pytest.approx(1 / 6)
    kinds = tables["by kind, simulated"]
    assert kinds[(kinds["method"] == "mine") & (kinds["kind"] == "piece")]["success_tre_rate"].tolist() == [
        pytest.approx(1 / 3)
    ]
    compared = tables["comparison of methods, simulated"].iloc[0]
    assert (compared["first_only"], compared["second_only"], compared["anatomies"], compared["cases"]) == (
        3,
        1,
        3,
        6,
    )


def test_methods_are_compared_by_anatomy() -> None:
    """Anatomies won by 2, lost by 1, won by 1: of 8 patterns of signs six are as far from even as 2 + 1 against 1."""
    compared = benchmark_tables(pd.concat([MINE, OTHER]))["comparison of methods, simulated"].iloc[0]
    assert compared["p"] == pytest.approx(0.75)
    assert compared["min_attainable_p"] == pytest.approx(0.25)
    assert compared["p_holm"] == pytest.approx(0.75)


def test_sentences_say_what_failed_and_what_was_not_accepted() -> None:
    said = " ".join(describe_benchmark(pd.concat([MINE, OTHER], ignore_index=True)))
    assert "mine: 3 of 6 cases within 2 mm TRE (50.0%, 95 % interval over 3 anatomies" in said
    assert "are right (wrong: b_whole)." in said
    assert "mine does not accept 3 of 6 results (declared failed: 1; right all the same: 1)" in said
    assert "in 1 of 2 a second pose explains the clouds within their noise" in said
    assert "right results not accepted without one: 1 (c_whole)" in said
    assert "other: its results are not judged." in said
    assert "other accepts" not in said
    assert "80.0 % (Wilson 95 % interval" in said
    assert "mine gave no result for 1 of 6 cases, which count as failed (first: lost)" in said
    assert "mine is right alone in 3 cases, other in 1" in said
    third = OTHER.assign(method="third")
    pairs = [one for one in describe_benchmark(pd.concat([OTHER, MINE, third])) if "McNemar" in one]
    assert len(pairs) == 2 and all("mine" in one for one in pairs)
    assert "mine: 2 of 2 cases within 2 mm TRE (100.0%)." in describe_benchmark(MINE[:2])


def test_symmetric_shapes_that_were_accepted_are_named() -> None:
    rows = pd.DataFrame(
        [
            row("s_whole", 20.0, symmetric=True, tre_symmetric_mm=0.1, success_tre_symmetric=True, tre_high_mm=1.0),
            row("t_whole", 20.0, "ambiguous", symmetric=True, tre_symmetric_mm=0.1, success_tre_symmetric=True,
                ambiguous_rightly=1.0, tre_high_mm=1.0),
        ]
    )  # fmt: skip
    said = " ".join(describe_benchmark(rows))
    assert "mine: 2 of 2 cases within 2 mm TRE, up to symmetry" in said
    assert "mine is sure of 1 shapes that have more than one right pose (s_whole)." in said
    found = benchmark_metrics(rows)
    assert found["success_tre_rate"] == 0.0
    assert found["success_tre_symmetric_rate"] == 1.0
    assert benchmark_tables(rows)["methods, simulated"]["success_tre_symmetric_rate"].tolist() == [1.0]


def test_a_method_that_accepts_nothing_has_no_rate_among_accepted() -> None:
    found = benchmark_metrics(MINE[MINE["verdict"] == "ambiguous"])
    assert found["acceptance_rate"] == 0.0
    assert "success_accepted_rate" not in found
    assert describe_benchmark(MINE[MINE["verdict"] == "ambiguous"])


def test_the_figure_has_its_three_parts() -> None:
    figure = benchmark_figures(pd.concat([MINE, OTHER], ignore_index=True))["rigid_benchmark"]
    risk, predicted, kinds = figure.axes
    # Two orders and one point for the method that judges itself, one point for the other.
    assert len(risk.lines) == 3
    assert risk.lines[2].get_xdata()[0] == pytest.approx(0.5)
    assert risk.lines[2].get_ydata()[0] == pytest.approx(1 / 3)
    assert sum(len(dots.get_offsets()) for dots in predicted.collections) == 5
    assert [label.get_text() for label in kinds.get_xticklabels()] == ["whole", "piece"]
    assert "simulated" in figure.get_suptitle()


def test_a_method_that_does_not_judge_has_no_acceptance() -> None:
    found = benchmark_metrics(OTHER)
    for name in ("acceptance_rate", "success_accepted_rate", "accepted_failures", "over_cautious"):
        assert name not in found
    methods = benchmark_tables(OTHER)["methods, simulated"]
    assert methods["acceptance_rate"].isna().all()
    assert not {"accepted wrongly, simulated", "not accepted, simulated"} & set(benchmark_tables(OTHER))


BLOCKS = pd.DataFrame(
    [
        row("a_bend", 1.5, block="deforming", tre_rigid_mm=0.9, lowest_tre_mm=1.0, tre_high_mm=3.0,
            covered_by_interval=1.0, high_over_error=2.0),
        row("b_bend", 2.5, block="deforming", tre_rigid_mm=1.5, lowest_tre_mm=2.0, tre_high_mm=1.0,
            covered_by_interval=0.0, high_over_error=0.4),
        row("a_own", 0.5, "ambiguous", block="wrong_vessel", tre_high_mm=1.0, covered_by_interval=1.0,
            high_over_error=2.0, ambiguous_rightly=0.0),
        row("b_own", 0.5, block="wrong_vessel", tre_high_mm=1.0, covered_by_interval=1.0, high_over_error=2.0),
        *(
            row(f"{name}_other", NAN, verdict, block="wrong_vessel", same_vessel=False, tre_high_mm=high_mm,
                tre_rigid_mm=NAN, lowest_tre_mm=NAN)
            for name, verdict, high_mm in (("a", "accepted", 0.8), ("b", "ambiguous", 5.0), ("c", "failed", 9.0),
                                           ("d", "ambiguous", 4.0))
        ),
    ]
)  # fmt: skip


def test_of_another_vessel_every_accepted_result_is_wrong() -> None:
    found = benchmark_metrics(BLOCKS[BLOCKS["block"] == "wrong_vessel"])
    assert found["cases"] == 6
    assert found["success_tre_rate"] == 1.0  # of the two that are of their own vessel
    assert found["right_accepted_rate"] == pytest.approx(1 / 2)
    assert found["accepted_wrong_rate"] == 0.0
    assert found["wrong_vessel_accepted_rate"] == pytest.approx(1 / 4)
    # Wilson, z = 1.95996, 1 of 4: worked out apart.
    assert found["wrong_vessel_accepted_rate_high"] == pytest.approx(0.6994, abs=1e-4)
    assert found["accepted_failures"] == 1
    assert found["tre_mm_mean"] == pytest.approx(0.5)
    # By the predicted error: wrong at 0.8, two right ones at 1.0, then three wrong ones.
    assert found["risk_area_tre_high_mm"] == pytest.approx((1 + 1 / 2 + 1 / 3 + 2 / 4 + 3 / 5 + 4 / 6) / 6)
    alone = benchmark_metrics(BLOCKS[~BLOCKS["same_vessel"]])
    assert "success_tre_rate" not in alone and "tre_mm_mean" not in alone
    unjudged = benchmark_metrics(BLOCKS.assign(verdict="not judged"))
    assert "wrong_vessel_accepted_rate" not in unjudged and "accepted_wrong_rate" not in unjudged


def test_where_tissue_deforms_errors_stand_beside_what_no_pose_undoes() -> None:
    found = benchmark_metrics(BLOCKS[BLOCKS["block"] == "deforming"])
    assert found["tre_mm_mean"] == pytest.approx(2.0)
    assert found["tre_rigid_mm_mean"] == pytest.approx(1.2)
    assert found["lowest_tre_mm_mean"] == pytest.approx(1.5)
    assert found["accepted_wrong_rate"] == pytest.approx(1 / 2)
    assert found["high_over_error_median"] == pytest.approx(1.2)
    assert "tre_rigid_mm_mean" not in benchmark_metrics(MINE)


def test_blocks_have_a_row_each() -> None:
    tables = benchmark_tables(BLOCKS)
    errors = tables["errors by block, simulated"].set_index("block")
    assert errors.loc["deforming", "cases"] == 2 and errors.loc["wrong_vessel", "cases"] == 2
    assert errors.loc["deforming", "interval_coverage_rate"] == pytest.approx(1 / 2)
    judged = tables["judgements by block, simulated"].set_index("block")
    assert judged.loc["wrong_vessel", "wrong_vessels"] == 4
    assert judged.loc["wrong_vessel", "wrong_vessel_accepted_rate"] == pytest.approx(1 / 4)
    assert math.isnan(judged.loc["deforming", "wrong_vessel_accepted_rate"])
    # Models of other vessels that were refused are as they should be; those accepted are named.
    assert tables["not accepted, simulated"]["case"].tolist() == ["a_own"]
    assert tables["accepted wrongly, simulated"]["case"].tolist() == ["b_bend", "a_other"]
    assert "errors by block, simulated" not in benchmark_tables(MINE)


def test_sentences_of_several_blocks_name_them() -> None:
    said = describe_benchmark(BLOCKS)
    assert (
        "Wrong vessel: mine accepts 25.0 % (Wilson 95 % interval 4.6 to 69.9) of 4 models of other"
        in " ".join(said)
    )
    assert any(one.endswith("mirror images (a_other).") for one in said)
    assert (
        "Deforming: mine: mean TRE 2.00 mm where the true rigid poses leave 1.50 mm; against these 1.20 mm."
        in said
    )
    alike = "that mine accepts leave no larger residual than its right results do (RMSE at most 0.20 mm) (a_other)."
    assert any(one.endswith(alike) for one in said)
    worse = BLOCKS.assign(rmse_mm=BLOCKS["rmse_mm"].where(BLOCKS["same_vessel"], 0.3))
    assert not any("no larger residual" in one for one in describe_benchmark(worse))
    unjudged = describe_benchmark(BLOCKS.assign(verdict="not judged"))
    assert any("cannot refuse the 4 models of other vessels" in one for one in unjudged)
    assert not any("Deforming" in one for one in describe_benchmark(MINE))


def test_the_figure_of_several_blocks_shows_these() -> None:
    _, predicted, blocks = benchmark_figures(BLOCKS)["rigid_benchmark"].axes
    assert [label.get_text() for label in blocks.get_xticklabels()] == ["deforming", "wrong vessel"]
    assert sum(len(dots.get_offsets()) for dots in predicted.collections) == 4
