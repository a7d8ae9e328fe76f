"""Comparisons of models whose differences are known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scored_cases import scored_cases

from experiments.analysis.segmentation.comparison import compare_models
from experiments.errors import InputError
from experiments.statistics import PairedComparison, by_unit, holm

GAINS = {"unet": 0.0, "same": 0.002, "better": 0.05}


def compared(cases: pd.DataFrame, metric: str = "dsc") -> pd.DataFrame:
    found = compare_models(cases)
    return found[found["metric"] == metric].set_index(["first", "second"])


def test_every_pair_by_group() -> None:
    cases = scored_cases(GAINS, groups=9, noise=0.004)
    found = compared(cases)
    assert list(found.index) == [("unet", "same"), ("unet", "better"), ("same", "better")]
    one, other = (by_unit(cases[cases["model"] == model], "dsc") for model in ("unet", "better"))
    expected = PairedComparison(margin=0.01)(one, other)
    row = found.loc[("unet", "better")]
    assert row["units"] == 9 and row["left_out"] == 0
    assert (row["first_mean"], row["second_mean"]) == pytest.approx((one.mean(), other.mean()))
    assert row["mean_difference"] == expected.mean_difference.estimate < 0
    assert row["mean_difference_ci_low"] == expected.mean_difference.low
    assert row["median_difference"] == expected.median_difference.estimate
    assert row["p"] == row["min_attainable_p"] == 2 / 2**9 and row["rank_biserial"] == -1.0
    assert found["p_holm"].to_list() == pytest.approx(holm(found["p"]))
    assert found["equivalence_p_holm"].to_list() == pytest.approx(holm(found["equivalence_p"]))


def test_verdicts_of_known_differences() -> None:
    found = compared(scored_cases(GAINS, groups=9, noise=0.004))
    assert found.loc[("unet", "better"), "verdict"] == "better better"
    assert found.loc[("same", "better"), "verdict"] == "better better"
    assert found.loc[("unet", "same"), "verdict"] == "equivalent within 0.01 DSC"
    assert found["equivalent"].to_list() == [True, False, False]
    distances = compared(scored_cases(GAINS, groups=9, noise=0.004), "hd95_px")
    # A smaller distance is the better one, and none is called equivalent.
    assert distances.loc[("unet", "better"), "rank_biserial"] == 1.0
    assert distances.loc[("unet", "better"), "verdict"] == "better better"
    assert distances.loc[("unet", "same"), "verdict"] == "no difference shown"
    assert np.isnan(distances["equivalence_p"]).all() and not distances["equivalent"].any()


def test_a_small_but_certain_difference_is_both() -> None:
    found = compared(scored_cases({"unet": 0.0, "better": 0.004}, groups=9))
    assert found["verdict"].to_list() == ["better better, within 0.01 DSC"]


def test_few_groups_show_nothing() -> None:
    found = compared(scored_cases({"unet": 0.0, "better": 0.3}, groups=4))
    assert found["verdict"].to_list() == ["no difference shown"]
    assert found["p"].to_list() == found["min_attainable_p"].to_list() == [0.125]
    same = compared(scored_cases({"unet": 0.0, "same": 0.0}, groups=4))
    assert same["verdict"].to_list() == ["no difference shown"] and not same["equivalent"].any()


def test_a_mean_that_a_few_groups_pull_away_is_not_called_better() -> None:
    cases = scored_cases({"unet": 0.0, "other": 0.02}, groups=12)
    lost = (cases["model"] == "other") & (cases["group"] == "g5") & cases["dsc"].notna()
    cases.loc[lost, "dsc"] = 0.0
    row = compared(cases).iloc[0]
    assert row["p_holm"] <= 0.05 and row["mean_difference"] > 0 > row["rank_biserial"]
    assert row["verdict"] == "other better in rank only" and not row["equivalent"]


def test_only_cases_that_all_models_scored() -> None:
    cases = scored_cases({"unet": 0.0, "other": 0.1, "third": 0.2})
    partly = cases[~((cases["model"] == "other") & (cases["fold"] == 2))]
    found = compared(partly)
    assert set(found["units"]) == {4} and set(found["left_out"]) == {6}
    whole = partly[partly["fold"] != 2]
    pd.testing.assert_frame_equal(found.drop(columns="left_out"), compared(whole).drop(columns="left_out"))


def test_models_that_share_no_case_are_not_compared() -> None:
    cases = scored_cases({"unet": 0.0, "other": 0.1})
    apart = cases[(cases["model"] == "unet") == (cases["fold"] == 0)]
    found = compared(apart)
    assert found["units"].to_list() == [0] and found["verdict"].to_list() == ["nothing to compare"]
    assert np.isnan(found[["p", "p_holm", "mean_difference", "rank_biserial"]].to_numpy(float)).all()


def test_seeds_are_averaged_before_groups_and_only_shared_ones_count() -> None:
    cases = scored_cases({"unet": 0.0, "other": 0.0}, seeds=(0, 1))
    cases.loc[(cases["model"] == "other") & (cases["seed"] == 1), "dsc"] += 0.1
    row = compared(cases).iloc[0]
    assert row["units"] == 6 and row["mean_difference"] == pytest.approx(-0.05)
    only = cases[~((cases["model"] == "unet") & (cases["seed"] == 1))]
    assert compared(only).iloc[0]["mean_difference"] == pytest.approx(0.0)


def test_data_sets_and_domains_are_families_of_their_own() -> None:
    both = pd.concat(
        [
            scored_cases(GAINS, simulated=True, spacing_mm=0.5),
            scored_cases(GAINS, dataset="y"),
        ],
        ignore_index=True,
    )
    found = compare_models(both)
    assert found.groupby(["dataset", "metric"], sort=False).size().to_dict() == {
        ("x (simulated)", "dsc"): 3,
        ("x (simulated)", "hd95_mm"): 3,
        ("y", "dsc"): 3,
        ("y", "hd95_px"): 3,
    }
    trained = pd.concat([both.assign(train_dataset=name) for name in ("x", "y")], ignore_index=True)
    assert len(compare_models(trained)) == 24
    assert set(compare_models(trained)["trained_on"]) == {"x", "y"}


def test_one_model_has_nothing_to_be_compared_with() -> None:
    assert not len(compare_models(scored_cases({"unet": 0.0})))


def test_two_settings_under_one_name_are_refused() -> None:
    cases = scored_cases({"unet": 0.0, "other": 0.0})
    with pytest.raises(InputError, match="more than once"):
        compare_models(pd.concat([cases, cases], ignore_index=True))
