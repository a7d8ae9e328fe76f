"""The loss of some of the frames that a moving cloud was seen in."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int64

from registration.checks import require_at_least
from registration.errors import InputError

SCATTERED, CONTIGUOUS, ALTERNATING = "scattered", "contiguous", "alternating"
LOSSES = (SCATTERED, CONTIGUOUS, ALTERNATING)


def loss_of(missing: str, trial: int) -> str:
    """Return how the frames of a trial are lost.

    Parameters
    ----------
    missing : {"scattered", "contiguous", "alternating"}
        With ``alternating``, scattered in even trials and contiguous in odd ones.
    trial : int
        Number of the trial.

    Returns
    -------
    {"scattered", "contiguous"}
        Kind of loss.

    Raises
    ------
    InputError
        If the kind is unknown.
    """
    if missing not in LOSSES:
        raise InputError(f"missing: expected one of {', '.join(LOSSES)}, received {missing!r}")
    if missing != ALTERNATING:
        return missing
    return CONTIGUOUS if trial % 2 else SCATTERED


def in_kept_frames(
    frame: Int64[np.ndarray, " n"], missing_share: float, loss: str, rng: np.random.Generator
) -> Bool[np.ndarray, " n"]:
    """Select the points that lie in frames that are left.

    Parameters
    ----------
    frame : ndarray of int, shape (n,)
        Frame of each point.
    missing_share : float
        Share of the frames that is lost, from 0 to below 1; at least one frame is left.
    loss : {"scattered", "contiguous"}
        Whether frames are lost one by one, or in a single run that begins anywhere.
    rng : numpy.random.Generator
        Random stream of the loss.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for points that are left.

    Raises
    ------
    InputError
        If the kind is unknown or the share is out of range.
    """
    require_at_least("missing_share", missing_share, 0.0)
    if missing_share >= 1:
        raise InputError(f"missing_share: expected below 1, received {missing_share:g}")
    if loss not in (SCATTERED, CONTIGUOUS):
        raise InputError(f"loss: expected {SCATTERED} or {CONTIGUOUS}, received {loss!r}")
    present = np.unique(frame)
    count = min(round(missing_share * len(present)), len(present) - 1)
    if loss == SCATTERED:
        lost = rng.permutation(present)[:count]
    else:
        begin = int(rng.integers(0, len(present) - count + 1))
        lost = present[begin : begin + count]
    return ~np.isin(frame, lost)
