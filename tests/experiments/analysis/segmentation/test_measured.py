"""Scores beside published ones: which data sets were published, and what networks differ by."""

from __future__ import annotations

from pathlib import Path

import pytest
from scored_cases import scored_cases

from experiments.analysis.segmentation.measured import measured
from experiments.outcome import JobResult
from experiments.reporting.measured import SIMULATED


def results(dataset: str, simulated: bool = False, prefix: str = "") -> list[JobResult]:
    gains = {f"{prefix}unet": 0.1, f"{prefix}unet3plus": 0.08}
    cases = scored_cases(gains, dataset=dataset, simulated=simulated, groups=5)
    return [JobResult({}, {}, cases, Path())]


def test_a_published_data_set_has_the_score_of_each_network_and_their_difference() -> None:
    unet, unet3plus, difference = measured(results("carotid"))
    assert (unet.name, unet.of, unet.n, unet.not_comparable) == ("dsc", "unet on carotid", 5, "")
    assert unet.value - unet3plus.value == pytest.approx(0.02)
    assert unet.low < unet.value < unet.high
    assert (difference.name, difference.of) == ("complexity", "unet minus unet3plus, carotid")
    assert difference.value == pytest.approx(0.02)


def test_other_data_sets_have_the_difference_alone() -> None:
    assert [one.name for one in measured(results("usgra"))] == ["complexity"]


def test_simulated_frames_and_smoke_trainings_say_so() -> None:
    assert {one.not_comparable for one in measured(results("phantom", simulated=True))} == {SIMULATED}
    small = measured(results("carotid", prefix="smoke-trained "))
    assert [(one.name, one.small) for one in small] == [("dsc", True), ("dsc", True)]
