"""How a pose is measured on both clouds."""

from __future__ import annotations

import numpy as np
import pytest

from registration import frames
from registration.icp import TreeTarget
from registration.results import fit

GRID = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), axis=-1).reshape(-1, 3)


def test_residuals_and_inliers_by_hand() -> None:
    """Ten points of a unit grid, lifted by 1 mm, two of them by 5 mm instead, brought down by 1 mm too little."""
    moving = GRID[:10] + np.array([0, 0, 2.0])
    moving[:2, 2] = 6.0
    found = fit(moving, TreeTarget(GRID), frames.translation((0, 0, -1.0)), keep=0.8, inlier_spacings=3.0)
    assert found.rmse_mm == pytest.approx(np.sqrt((8 * 1 + 2 * 25) / 10))
    assert found.rmse_trimmed_mm == pytest.approx(1)
    assert found.inlier_share == pytest.approx(0.8)
