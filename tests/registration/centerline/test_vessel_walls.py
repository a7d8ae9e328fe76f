"""Inside and distance of a tube whose ends are open."""

from __future__ import annotations

import numpy as np
from tubes import straight, tube

from registration.centerline.vessel_walls import Walls
from registration.geometry.mesh_topology import borders, with_caps


def test_an_open_end_is_no_wall_but_ends_the_inside() -> None:
    line_mm = straight(40.0)
    direction = (line_mm[-1] - line_mm[0]) / np.linalg.norm(line_mm[-1] - line_mm[0])
    open_tube = tube(line_mm, 4.0, around=64)
    walls = Walls(open_tube, with_caps(open_tube, borders(open_tube)))
    asked_mm = line_mm[0] + np.array([-0.5, 0.01, 20.0, 39.99, 40.5])[:, None] * direction
    assert walls.inside(asked_mm).tolist() == [False, True, True, True, False]
    # The triangles of a 64-sided tube come as near as 4 cos(pi / 64).
    np.testing.assert_allclose(walls.distance_mm(asked_mm[1:4]), 4.0, atol=0.01)
    assert len(walls.inside(np.empty((0, 3)))) == 0


def test_how_far_the_closed_surface_is_ahead() -> None:
    line_mm = straight(40.0)
    direction = (line_mm[-1] - line_mm[0]) / np.linalg.norm(line_mm[-1] - line_mm[0])
    open_tube = tube(line_mm, 4.0, around=64)
    walls = Walls(open_tube, with_caps(open_tube, borders(open_tube)))
    assert abs(walls.ahead_mm(line_mm[10], direction) - 32.0) < 1e-3
    assert abs(walls.ahead_mm(line_mm[10], -direction) - 8.0) < 1e-3
    assert walls.ahead_mm(line_mm[-1] + direction, direction) == np.inf
