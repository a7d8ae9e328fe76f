"""Numbers of one thing that is compared: the study's own over all cases, else means; infinite ones hide nothing."""

from __future__ import annotations

import math
from pathlib import Path
from types import ModuleType

import pytest

from experiments.outcome import JobResult
from experiments.running.jobs import Job
from experiments.running.variants import hash_of, metrics_of, shown_metrics, variants_of


def job(label: str) -> Job:
    return Job({"study": "counting"}, label, label)


def result(**metrics: float) -> JobResult:
    return JobResult({"study": "counting"}, metrics, None, Path())


def test_folds_and_seeds_are_repeats_and_all_else_is_compared(counting_study: ModuleType) -> None:
    labels = ["part=1,seed=0", "part=1,seed=1", "part=2,seed=0", "part=1,fold=3,outer_fold=1"]
    groups = [[one.label for one in variant.jobs] for variant in variants_of([job(each) for each in labels])]
    assert groups == [[labels[0], labels[1], labels[3]], [labels[2]]]


def test_the_hash_does_not_depend_on_the_order() -> None:
    assert hash_of([job("a"), job("b")]) == hash_of([job("b"), job("a")]) != hash_of([job("a")])


def test_means_over_jobs_and_the_spread_of_the_first_metric(counting_study: ModuleType) -> None:
    found = metrics_of([job("a"), job("b")], [result(value=1.0, time_s=4.0), result(value=2.0, time_s=8.0)])
    assert found == pytest.approx({"value": 1.5, "time_s": 6.0, "value_std_over_jobs": math.sqrt(0.5)})


def test_a_job_that_failed_in_a_metric_leaves_no_mean_of_the_others(counting_study: ModuleType) -> None:
    found = metrics_of([job("a"), job("b")], [result(tre_mm=math.inf, n=1.0), result(tre_mm=1.0, n=3.0)])
    assert found == {"n": 2.0}


def test_a_single_job_has_no_spread(counting_study: ModuleType) -> None:
    assert metrics_of([job("a")], [result(value=1.0)]) == {"value": 1.0}


def test_a_study_that_fails_at_the_end_leaves_means(counting_study: ModuleType, capsys) -> None:
    def over_repeats(results: list[JobResult]) -> dict[str, float]:
        raise ValueError("no cases")

    counting_study.over_repeats = over_repeats
    assert metrics_of([job("a")], [result(value=1.0)]) == {"value": 1.0}
    assert "means alone (no cases)" in capsys.readouterr().err


def test_what_the_study_computes_of_all_cases_goes_before_means(counting_study: ModuleType) -> None:
    counting_study.over_repeats = lambda results: {"value": 7.0}
    counting_study.HEADLINE = ("time_s", "value")
    results = [result(value=1.0, time_s=2.0, rest=1.0), result(value=2.0, time_s=2.0, rest=1.0)]
    found = metrics_of([job("a"), job("b")], results)
    assert found["value"] == 7.0 and found["time_s_std_over_jobs"] == 0.0
    assert shown_metrics(found, "counting") == {"time_s": 2.0, "value": 7.0, "time_s_std_over_jobs": 0.0}
