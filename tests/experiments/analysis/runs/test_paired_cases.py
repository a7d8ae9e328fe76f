"""The cases that two runs have in common: by their names, their seeds and their methods; and what has none."""

from __future__ import annotations

import pandas as pd
import pytest
from run_families import alone, job, segmented, sweep, trials

from experiments.analysis.runs.paired_cases import cases_of, pair_cases
from experiments.errors import InputError

SCORES = [0.8, 0.7, 0.6]


def test_cases_are_paired_by_name_and_those_of_one_run_alone_are_counted() -> None:
    first = alone("a", segmented(SCORES, "unet"))
    second = alone("b", segmented([0.5, 0.4, 0.3, 0.2], "attention_unet", first=1))
    found = pair_cases(first, second)
    assert found.pairs["case_id"].tolist() == ["c1", "c2"]
    assert found.pairs["dsc_first"].tolist() == [0.7, 0.6]
    assert found.pairs["dsc_second"].tolist() == [0.5, 0.4]
    assert (found.alone, found.unit, found.strata) == ((1, 2), "group", ())
    assert found.metrics == ("dsc", "hd95_px", "false_alarm")


def test_seeds_and_folds_of_a_sweep_are_repetitions_and_only_seeds_of_both_count() -> None:
    jobs = [job(str(seed), segmented([seed / 10] * 3, seed=seed), parent="top") for seed in (1, 2, 3)]
    found = pair_cases(sweep("top", jobs), sweep("other", [jobs[1], jobs[2]]))
    assert found.pairs["dsc_first"].tolist() == pytest.approx([0.25] * 3)
    assert "only 2, 3 count, which both have" in found.notes[0]
    apart = pair_cases(alone("a", segmented(SCORES, seed=1)), alone("b", segmented(SCORES, seed=2)))
    assert len(apart.pairs) == 3
    assert "no seed in common (1 and 2)" in apart.notes[0]


def test_runs_of_several_models_are_compared_within_each_and_others_are_named() -> None:
    both = pd.concat([segmented(SCORES, "unet"), segmented(SCORES, "attention_unet")])
    found = pair_cases(alone("a", both), alone("b", segmented(SCORES, "unet")))
    assert found.strata == ("model",)
    assert set(found.pairs["model"]) == {"unet"}
    assert "Only one of the runs has the model attention_unet" in found.notes[0]
    with pytest.raises(
        InputError, match="a model in common, or one alone in each run, received attention_unet, unet"
    ):
        pair_cases(alone("a", both), alone("b", segmented(SCORES, "unet3plus")))


def test_trials_of_other_seeds_are_other_trials() -> None:
    cases = trials({"aorta": [1.0, 3.0]})
    first = alone("a", cases, {"seed": 0}, experiment="robustness")
    second = alone("b", cases, {"seed": 1}, experiment="robustness")
    with pytest.raises(InputError, match="cases in common, found none: seed of the run is 0 and 1"):
        pair_cases(first, second)
    same = pair_cases(first, alone("c", trials({"aorta": [2.0, 2.0]}, "multistart"), experiment="robustness"))
    assert same.unit == "anatomy"
    assert len(same.pairs) == 2


def test_other_data_are_refused_where_both_say_so() -> None:
    first = alone("a", segmented(SCORES), digest="1" * 36)
    assert len(pair_cases(first, alone("b", segmented(SCORES), digest="1" * 36)).pairs) == 3
    with pytest.raises(
        InputError, match="expected the same data in both, received drawn with the digests 1111"
    ):
        pair_cases(first, alone("b", segmented(SCORES), digest="2" * 36))
    named = segmented(SCORES).assign(data_digest="3" * 64)
    with pytest.raises(InputError, match="expected the same data in both"):
        pair_cases(first, alone("b", named))


def test_runs_without_cases_metrics_or_a_common_case_are_refused() -> None:
    with pytest.raises(InputError, match="run b: expected finished jobs with a table of cases"):
        pair_cases(alone("a", segmented(SCORES)), alone("b", None))
    with pytest.raises(InputError, match="expected cases with one of dsc"):
        pair_cases(
            alone("a", segmented(SCORES)), alone("b", pd.DataFrame({"case_id": ["c0"], "value": [1.0]}))
        )
    with pytest.raises(InputError, match="found none: group is g0, g1, g2 and g9, g10, g11"):
        pair_cases(alone("a", segmented(SCORES)), alone("b", segmented(SCORES, first=9)))
    with pytest.raises(InputError, match="unit: expected a column that says which case a row is"):
        pair_cases(alone("a", segmented(SCORES)), alone("b", segmented(SCORES)), "dsc")


def test_rows_of_a_table_that_are_no_cases_do_not_count() -> None:
    table = pd.concat([segmented(SCORES).assign(kind="case"), segmented(SCORES).assign(kind="barrier")])
    assert len(cases_of(alone("a", table))) == 3
