"""Medians and intervals over pairs of sweeps, checked on tables made by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from consistency_rows import cases

from experiments.studies.consistency.report import describe, figures, median_of_pairs, metrics, tables


def test_sweeps_that_are_all_as_far_apart_leave_no_doubt() -> None:
    found = median_of_pairs(cases(np.full((6, 6), 0.3)), "hd95_mm")
    assert (found.estimate, found.low, found.high, found.units) == (0.3, 0.3, 0.3, 6)


def test_one_bad_sweep_among_eight_widens_the_interval_upwards() -> None:
    apart_mm = np.full((8, 8), 0.3)
    apart_mm[0] = apart_mm[:, 0] = 2.0
    found = median_of_pairs(cases(apart_mm), "hd95_mm")
    # 7 of 28 pairs are far apart; drawn three times or more, they are the majority.
    assert found.estimate == 0.3
    assert (found.low, found.high) == (0.3, 2.0)


def test_a_failed_sweep_ranks_worst_and_is_counted() -> None:
    apart_mm = np.full((4, 4), 0.3)
    apart_mm[0] = apart_mm[:, 0] = np.inf
    table = cases(apart_mm)
    failed = (table["kind"] == "truth") & (table["first"] == 0)
    table.loc[failed, ["msd_covered_mm", "hd95_covered_mm"]] = np.inf
    table.loc[failed, ["bias_mm", "covered_second", "runtime_s"]] = np.nan
    table.loc[failed, "error"] = "cloud: too few points"
    found = metrics(table)
    # Three of six pairs have it: the median lies between a number and infinity.
    assert found["hd95_mm_median"] == np.inf
    assert found["truth_hd95_covered_mm_median"] == 0.9
    assert found["truth_msd_covered_mm_mean"] == np.inf
    assert found["truth_bias_mm_mean"] == pytest.approx(-0.1)
    assert found["sweeps_failed"] == 1
    interval = median_of_pairs(table, "hd95_mm")
    assert (interval.low, interval.high) == (0.3, np.inf)
    assert "1 of 4 sweeps could not be reconstructed" in describe(table)[1]
    assert tables(table)["to the truth, simulated"]["failed"].tolist() == [1]
    assert figures(table)["consistency"].axes


def test_two_sweeps_have_no_interval() -> None:
    found = median_of_pairs(cases(np.full((2, 2), 0.3)), "hd95_mm")
    assert found.estimate == 0.3
    assert np.isnan([found.low, found.high]).all()


def test_metrics_and_tables_keep_pairs_and_truth_apart() -> None:
    both = pd.concat([cases(np.full((4, 4), 0.3)), cases(np.full((3, 3), 0.7), "artery")], ignore_index=True)
    found = metrics(both)
    # Six pairs of one phantom and three of the other.
    assert found["hd95_mm_median"] == 0.3
    assert found["hd95_mm_mean"] == pytest.approx((6 * 0.3 + 3 * 0.7) / 9)
    assert found["truth_hd95_covered_mm_median"] == 0.9
    assert found["common_mm"] == 0.4
    between, to_truth = tables(both).values()
    assert between["hd95_mm_median"].tolist() == [0.3, 0.7, 0.3]
    # No interval over sweeps of different phantoms.
    assert np.isnan(between["hd95_mm_low"].iloc[2])
    assert not between["hd95_mm_low"].iloc[:2].isna().any()
    assert to_truth["sweeps"].tolist() == [4, 3, 7]
    assert to_truth["bias_mm_mean"].tolist() == pytest.approx([-0.1] * 3)


def test_sentences_and_figure_say_what_is_simulated() -> None:
    table = cases(np.full((4, 4), 0.3))
    said = describe(table)
    assert said[0].startswith("vein: 6 pairs of sweeps lie 0.30 mm apart on average")
    assert "95 % interval over 4 sweeps 0.30 to 0.30" in said[0]
    assert "0.100 mm too far in" in said[0]
    assert "< 0.8 mm" in said[1]
    assert "not comparable" in said[1]
    assert "not comparable" not in describe(table.assign(simulated=False))[1]
    figure = figures(table)["consistency"]
    assert "simulated" in figure.get_suptitle()
    # The published line is in view.
    assert figure.axes[1].get_ylim()[1] > 0.8


def test_two_sweeps_have_no_interval_and_the_sentence_says_so() -> None:
    said = describe(cases(np.full((2, 2), 0.3)))
    assert said[0].startswith("vein: 1 pair of sweeps lies 0.30 mm apart on average")
    assert "too few sweeps for an interval" in said[0]
    assert "nan" not in " ".join(said)
