"""The frame rate of the modelled acquisition, and the share of pre-processing in one pass over the frames."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.studies.runtime.chain import rate_of, segmented
from experiments.studies.runtime.costs import Cost


def test_the_rate_counts_the_intervals_between_frames() -> None:
    assert rate_of(np.array([5.0, 5.5, 6.0])) == 2.0


@pytest.mark.parametrize("times_s", [np.array([]), np.array([1.0]), np.array([1.0, 1.0])])
def test_a_sweep_without_a_rate_is_refused(times_s: np.ndarray) -> None:
    with pytest.raises(InputError, match="frame_rate_hz: expected a sweep with a frame rate"):
        rate_of(times_s)


def test_preprocessing_and_the_rest_add_up_to_the_pass_and_share_its_memory() -> None:
    masks = np.arange(12, dtype=np.float32).reshape(3, 2, 2)
    sweep = SimpleNamespace(
        images=np.zeros((3, 2, 2), np.uint8), calibration=SimpleNamespace(spacing_mm=(0.1, 0.2))
    )

    def stream(frames: Any) -> Any:
        for mask, frame in zip(masks, frames, strict=True):
            assert frame.spacing_mm == (0.1, 0.2)
            yield SimpleNamespace(soft_mask=mask, times=SimpleNamespace(preprocessing_s=-2.0))

    costs: list[Cost] = []
    truth: Any = SimpleNamespace(sweep=sweep)
    predictor: Any = SimpleNamespace(stream=stream)
    np.testing.assert_array_equal(segmented(predictor, truth, costs), masks)
    preprocessing, rest = costs
    assert (preprocessing.stage, rest.stage) == ("preprocessing", "segmentation")
    # Negative times, so that the difference cannot be mistaken for the time of the pass.
    assert preprocessing.seconds == -6.0 and rest.seconds > 6.0
    assert preprocessing.peak_memory_mb == pytest.approx(rest.peak_memory_mb, nan_ok=True)
