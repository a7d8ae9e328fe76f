"""The three phantoms: vessels of fixed, known shape.

Sizes follow published anatomy: the common femoral artery measures 8 to 10 mm across (Sandgren et al., J. Vasc. Surg.
29, 1999), the superficial femoral artery 5 to 7 mm, the common femoral vein about 12 mm (Fronek et al., J. Vasc. Surg.
33, 2001) and is flattened by any pressure from the probe. No design is symmetric: bends in and out of the image
plane, tapers and branches of different size make one pose only fit.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from registration.phantom.shapes import VesselLine, spline_line

SKIN_Y_MM = -17.0


def artificial() -> tuple[VesselLine, ...]:
    """Design a tube 8 mm across, bent in two planes, with a side tube 5 mm across.

    Returns
    -------
    tuple of VesselLine
        Main and side tube in the ct frame.
    """
    main = spline_line(
        np.array([[-5, 1, -42], [-1.5, -1, -22], [4, 0.5, -2], [3, 3.5, 18], [-3, 2, 42]], dtype=float),
        np.full(5, 4.0),
    )
    side = spline_line(
        np.array([[4, 0.5, -2], [8, 0, 9], [12, -1.5, 22], [13, -3, 36]], dtype=float),
        np.full(4, 2.5),
    )
    return main, side


def vein() -> tuple[VesselLine, ...]:
    """Design a gently curved vein, 12 mm wide and 7.5 mm deep at its largest, with one tributary.

    Returns
    -------
    tuple of VesselLine
        Main vein and tributary in the ct frame.
    """
    main = spline_line(
        np.array([[4, 2, -42], [2.5, 3, -20], [-1, 2, 0], [-3, 0, 20], [-1, -1.5, 42]], dtype=float),
        np.array([3.1, 3.4, 3.8, 3.6, 3.3]),
        np.array([1.45, 1.55, 1.6, 1.5, 1.4]),
    )
    tributary = spline_line(
        np.array([[-1, 2, 0], [-6, 1.5, -8], [-10, -1, -20], [-11, -3, -36]], dtype=float),
        np.array([2.2, 2.2, 2.0, 1.8]),
        np.full(4, 1.3),
    )
    return main, tributary


def artery() -> tuple[VesselLine, ...]:
    """Design a strongly curved artery, 7 mm across, that forks into branches of 5.6 and 4.4 mm.

    Returns
    -------
    tuple of VesselLine
        Trunk, superficial and deep branch in the ct frame.
    """
    fork = [0.5, 1.0, 2.0]
    trunk = spline_line(
        np.array([[-6, 4, 42], [1, 0.5, 28], [4.5, -1.5, 15], fork], dtype=float),
        np.array([3.6, 3.5, 3.4, 3.2]),
    )
    superficial = spline_line(
        np.array([[4.5, -1.5, 15], fork, [-5.5, 1.5, -9], [-8.5, -1.5, -24], [-5.5, -3.5, -42]], dtype=float),
        np.array([2.6, 2.8, 2.7, 2.6, 2.4]),
    )
    deep = spline_line(
        np.array([[4.5, -1.5, 15], fork, [4, 4.5, -9], [8.5, 6.5, -22], [9.5, 8, -40]], dtype=float),
        np.array([2.2, 2.3, 2.2, 2.1, 1.9]),
    )
    return trunk, superficial, deep


DESIGNS: dict[str, Callable[[], tuple[VesselLine, ...]]] = {
    "artificial": artificial,
    "vein": vein,
    "artery": artery,
}
