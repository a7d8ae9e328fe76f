"""What the studies on sweeps share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.inputs.paths import describe_dropped, interval_ms, require_exists


def test_intervals() -> None:
    assert interval_ms(np.array([0.0, 0.1, 0.2, 0.5])) == pytest.approx((100.0, 300.0))
    assert np.isnan(interval_ms(np.array([1.0]))).all()


def test_dropped_frames_in_words() -> None:
    assert describe_dropped({}) == "none"
    assert describe_dropped({"a": 2, "b": 1}) == "2 a, 1 b"


def test_path_must_exist(tmp_path: Path) -> None:
    assert require_exists(str(tmp_path), "sweep") == tmp_path
    with pytest.raises(InputError, match=r"sweep: expected a file or folder, received .*nothing'"):
        require_exists(str(tmp_path / "nothing"), "sweep")
