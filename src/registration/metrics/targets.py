"""The fixed points of a model at which the target registration error is measured."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from registration.geometry.shapes import Centerline, Mesh, Surface

MAX_TARGETS = 500


def target_points(
    surface: Surface, centerline: Centerline | None = None, seed: int = 0
) -> Float64[np.ndarray, "t 3"]:
    """Choose the target points of a fixed model, the same whatever method is measured at them.

    Parameters
    ----------
    surface : Mesh or ndarray, shape (n, 3)
        The fixed surface, in mm in its own coordinate frame.
    centerline : Centerline, optional
        Its centerline in the same coordinate frame. Its points at even arc length are taken where it is given.
    seed : int, optional
        Of the points drawn on the surface where there is no centerline: fixed, and no setting of a run, so that
        two results are measured at the same places.

    Returns
    -------
    ndarray, shape (t, 3)
        At most ``MAX_TARGETS`` points, in mm in the coordinate frame of ``surface``.

    Examples
    --------
    >>> target_points(np.arange(9.0).reshape(3, 3)).shape
    (3, 3)
    """
    if centerline is not None:
        return centerline.even_points(MAX_TARGETS)
    rng = np.random.default_rng(seed)
    if isinstance(surface, Mesh):
        return surface.sample(MAX_TARGETS, rng)
    return rng.permutation(surface, axis=0)[:MAX_TARGETS]
