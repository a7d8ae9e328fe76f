"""Residuals of a bent tube against itself, whose gaps a test replaces by what it draws."""

from __future__ import annotations

import numpy as np
from vessels import bent_tube

from registration.rigid.residual_model.covariance import CovarianceParts
from registration.rigid.residual_model.grouped_residuals import grouped_residuals, groups_on
from registration.rigid.smoothed_target import outward_targets

TUBE = bent_tube()
POINTS_MM = TUBE.sample(2400, np.random.default_rng(2))
TARGET = outward_targets(TUBE.sample(4000, np.random.default_rng(1)), 20, 40)[1]
BARE = grouped_residuals(
    POINTS_MM, TARGET, np.eye(4), block=groups_on(POINTS_MM, TARGET, np.eye(4), 128), offset=True
)
PARTS = CovarianceParts(BARE)
