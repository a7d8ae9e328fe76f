"""Times beside the published ones: medians over repeats and the share of what comes before reconstruction."""

from __future__ import annotations

from pathlib import Path

import pytest
from runtime_rows import SECONDS, costs

from experiments.outcome import JobResult
from experiments.studies.runtime.measured import measured


def test_the_total_is_the_median_and_the_share_that_of_the_first_stages() -> None:
    total, share = measured([JobResult({}, {}, costs(), Path())])
    assert (total.name, total.of, total.value, total.n, total.units) == (
        "total_s", "vein", 16.5, 3, "repeats",
    )  # fmt: skip
    assert "16.5 to 19.5 s over 3 repeats" in total.said
    assert share.value == pytest.approx((10.0 + 1.0 + 4.0) / 16.5)
    assert "acquisition 61%" in share.said


def test_exact_masks_are_told() -> None:
    exact = {
        stage: taken for stage, taken in SECONDS.items() if stage not in ("preprocessing", "segmentation")
    }
    total, share = measured([JobResult({}, {}, costs(exact), Path())])
    assert "without pre-processing and segmentation" in total.said
    assert share.value == pytest.approx(10.0 / 11.5)
    assert measured([]) == []
