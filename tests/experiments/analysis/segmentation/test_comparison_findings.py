"""What is said of comparisons: no more than was shown."""

from __future__ import annotations

import pandas as pd
import pytest
from scored_cases import scored_cases

from experiments.analysis.segmentation.case_table import SMOKE, smoke_note
from experiments.analysis.segmentation.comparison import compare_models
from experiments.analysis.segmentation.comparison_findings import (
    comparison_metrics,
    comparison_table,
    describe_comparison,
)
from experiments.analysis.segmentation.findings import describe

GAINS = {"unet": 0.0, "same": 0.002, "better": 0.05}
NINE_GROUPS = compare_models(scored_cases(GAINS, groups=9, noise=0.004, simulated=True))


def test_a_sentence_for_every_comparison_with_its_test() -> None:
    sentences = describe_comparison(NINE_GROUPS)
    assert len(sentences) == 6
    assert all(sentence.startswith("On x (simulated), ") for sentence in sentences)
    row = NINE_GROUPS.iloc[1]
    low, high = row["mean_difference_ci_low"], row["mean_difference_ci_high"]
    assert sentences[1] == (
        f"On x (simulated), dsc of unet less that of better: mean difference {row['mean_difference']:+.3f} (95 % "
        f"interval {low:+.3f} to {high:+.3f}) over 9 groups; better better (exact signed-rank p = 0.004, with Holm's "
        f"adjustment 0.012; rank-biserial correlation -1.00)."
    )
    assert "equivalent within 0.01 DSC" in sentences[0] and "equivalence p = " in sentences[0]
    assert "no difference shown" in sentences[3] and "equivalen" not in sentences[3]


def test_groups_too_few_to_show_anything_are_told() -> None:
    # Three pairs of five groups: 0.0625 at least, 0.1875 after adjustment.
    sentences = describe_comparison(compare_models(scored_cases(GAINS, groups=5)))
    assert all("no difference shown" in sentence for sentence in sentences)
    assert (
        "so few groups can show none: the least p they can give is 0.062, 0.188 after adjustment"
        in sentences[1]
    )
    assert not any("so few groups" in sentence for sentence in describe_comparison(NINE_GROUPS))
    # Six groups would do for one pair, not for three.
    pair = {name: GAINS[name] for name in ("unet", "better")}
    assert "better better" in describe_comparison(compare_models(scored_cases(pair, groups=6)))[0]
    assert "so few groups" in describe_comparison(compare_models(scored_cases(GAINS, groups=6)))[1]


def test_cases_left_out_and_nothing_shared_are_told() -> None:
    cases = scored_cases({"unet": 0.0, "other": 0.1})
    partly = cases[~((cases["model"] == "other") & (cases["fold"] == 2))]
    assert (
        "over 4 groups (6 cases not scored by all models left out)"
        in describe_comparison(compare_models(partly))[0]
    )
    apart = compare_models(cases[(cases["model"] == "unet") == (cases["fold"] == 0)])
    assert (
        describe_comparison(apart)[0]
        == "On x, dsc of unet less that of other: no case was scored by all models."
    )
    assert comparison_table(apart).iloc[0].to_dict() == {
        "dataset": "x",
        "metric": "dsc",
        "units": 0,
        "models": "unet - other",
        "mean_difference": "",
        "rank_biserial": "",
        "p_holm": "",
        "min_attainable_p": "",
        "verdict": "nothing to compare",
    }
    assert comparison_metrics(apart) == {}


def test_one_group_has_a_difference_and_no_interval() -> None:
    found = compare_models(scored_cases({"unet": 0.0, "other": 0.1}, groups=1))
    assert "mean difference -0.100 over 1 groups; no difference shown" in describe_comparison(found)[0]
    assert comparison_table(found)["mean_difference"].iloc[0] == "-0.100"


def test_the_table_is_narrow_and_tells_small_p_from_none() -> None:
    shown = comparison_table(compare_models(scored_cases({"unet": 0.0, "better": 0.1}, groups=20)))
    assert shown.iloc[0]["p_holm"] == "1.9e-06" and shown.iloc[0]["rank_biserial"] == "-1.00"
    assert shown.iloc[0]["mean_difference"] == "-0.100 [-0.100, -0.100]"
    assert shown.iloc[1]["mean_difference"] == "+10.00 [+10.00, +10.00]"


def test_metrics_are_the_numbers_of_the_comparison() -> None:
    metrics = comparison_metrics(NINE_GROUPS)
    assert metrics["unet - better/x/dsc_mean_difference"] == NINE_GROUPS.iloc[1]["mean_difference"]
    assert metrics["unet - better/x/dsc_p_holm"] == pytest.approx(3 * 2 / 2**9)
    assert "unet - better/x/dsc_equivalence_p_holm" in metrics
    assert "unet - better/x/hd95_px_equivalence_p_holm" not in metrics


def test_what_was_trained_on_is_told() -> None:
    cases = scored_cases({"unet": 0.0, "other": 0.1}).assign(train_dataset="y")
    found = compare_models(cases)
    assert describe_comparison(found)[0].startswith("Trained on y, tested on x, dsc of unet")
    assert list(comparison_table(found))[:2] == ["trained_on", "dataset"]
    assert "unet - other/y/x/dsc_p" in comparison_metrics(found)


def test_nothing_to_say_of_no_comparison() -> None:
    assert describe_comparison(pd.DataFrame()) == () and not len(comparison_table(pd.DataFrame()))


def test_networks_trained_for_a_look_alone_are_compared_with_nothing_and_called_so_on_every_line() -> None:
    """Of nine groups the difference would be significant, whatever the training was for."""
    names = {f"{SMOKE}unet": 0.05, f"{SMOKE}unet3plus": 0.0, "unet": 0.0, "same": 0.002}
    cases = scored_cases(names, groups=9, noise=0.004)
    compared = compare_models(cases)
    assert set(compared["first"]) | set(compared["second"]) == {"unet", "same"}
    said = describe(cases)
    assert [sentence.startswith(SMOKE) for sentence in said] == [True, True, False, False]
    (note,) = smoke_note(cases)
    assert "trainer=smoke shows that all works and not how well" in note
    alone = cases[cases["model"].str.startswith(SMOKE)]
    assert not len(compare_models(alone))
    assert describe_comparison(compare_models(alone)) == ()
    assert smoke_note(cases[cases["model"] == "unet"]) == ()
