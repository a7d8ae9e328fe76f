"""Compact blocks of neighbouring points, whose residuals hang together."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64


def blocks_of(points_mm: Float64[np.ndarray, "n 3"], count: int) -> Int64[np.ndarray, " n"]:
    """Divide a cloud into compact blocks of equally many points.

    The cloud is halved across its longest side again and again, as a k-d tree is built: isolated points around it do
    not get blocks of their own.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points in mm.
    count : int
        About how many blocks there are.

    Returns
    -------
    ndarray of int, shape (n,)
        Block of each point.
    """
    block = np.zeros(len(points_mm), dtype=np.int64)
    for _ in range(round(np.log2(min(count, len(points_mm))))):
        halves = 2 * block
        for place in range(int(block.max()) + 1):
            own = np.flatnonzero(block == place)
            side = int(np.ptp(points_mm[own], axis=0).argmax())
            far = np.argsort(points_mm[own, side], kind="stable")[len(own) // 2 :]
            halves[own[far]] += 1
        block = halves
    return block


def blocks_of_frames(frame: Int64[np.ndarray, " n"], count: int) -> Int64[np.ndarray, " n"]:
    """Divide points into blocks of consecutive frames.

    Parameters
    ----------
    frame : ndarray of int, shape (n,)
        Frame that each point was seen in.
    count : int
        Largest number of blocks.

    Returns
    -------
    ndarray of int, shape (n,)
        Block of each point.
    """
    _, order = np.unique(frame, return_inverse=True)
    frames_n = int(order.max()) + 1
    return order.reshape(-1).astype(np.int64) * min(count, frames_n) // frames_n
