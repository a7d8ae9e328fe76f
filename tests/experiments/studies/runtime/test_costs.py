"""The peak of memory is that of the stage, not of all stages before it."""

from __future__ import annotations

import math
import time
from pathlib import Path

import numpy as np
import pytest

from experiments.studies.runtime import costs
from experiments.studies.runtime.costs import Cost, measured


@pytest.mark.skipif(not costs.RESET.exists(), reason="the kernel keeps one peak for the whole process")
def test_a_stage_is_not_charged_with_the_memory_of_an_earlier_one() -> None:
    found: list[Cost] = []
    with measured(found, "large"):
        np.ones(25_000_000)
    with measured(found, "small"):
        time.sleep(0.01)
    large, small = found
    # 200 MB, given back at once.
    assert large.peak_memory_mb - small.peak_memory_mb > 150
    assert (large.stage, small.stage) == ("large", "small") and small.seconds >= 0.01


def test_where_the_peak_cannot_begin_anew_it_is_not_known(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(costs, "RESET", tmp_path / "none" / "clear_refs")
    found: list[Cost] = []
    with measured(found, "stage"):
        pass
    assert math.isnan(found[0].peak_memory_mb) and found[0].seconds >= 0
