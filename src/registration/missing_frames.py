"""The loss of some of the frames that a moving cloud was seen in."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int64

from registration.checks import require_at_least
from registration.errors import InputError

SCATTERED, CONTIGUOUS, ALTERNATING = "scattered", "contiguous", "alternating"
LOSSES = (SCATTERED, CONTIGUOUS, ALTERNATING)


def loss_of(missing: str, trial: int) -> str:
    """How the frames of a trial get lost: with ``alternating``, scattered in even trials and contiguous in odd ones."""
    if missing not in LOSSES:
        raise InputError(f"missing: expected one of {', '.join(LOSSES)}, received {missing!r}")
    if missing != ALTERNATING:
        return missing
    return CONTIGUOUS if trial % 2 else SCATTERED


def seen(
    frame: Int64[np.ndarray, "n"], missing_share: float, loss: str, rng: np.random.Generator
) -> Bool[np.ndarray, "n"]:
    """Which points (n,) lie in frames that are left when ``missing_share`` of them are lost.

    ``scattered`` frames are drawn one by one, ``contiguous`` ones are a single run that begins anywhere. Raises
    InputError for another loss, or a share outside 0 to below 1.
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
