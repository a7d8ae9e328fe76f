"""Exact distribution of a sum of weights whose signs are fair coins, which the paired tests share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

# Beyond, the exact sum takes seconds and differs from the normal one in no digit that is read.
EXACT_UP_TO = 1000


@dataclass(frozen=True)
class Tails:
    """Tail probabilities of a sum of randomly signed weights.

    Parameters
    ----------
    at_most, at_least : float
        Probability of a positive sum at most, and at least, as large as the observed one.
    min_one_sided : float
        Probability of the largest sum possible.
    exact : bool
        Whether the probabilities are exact.
    """

    at_most: float
    at_least: float
    min_one_sided: float
    exact: bool

    @property
    def two_sided(self) -> float:
        """Twice the smaller tail: the distribution is symmetric."""
        return min(1.0, 2 * min(self.at_most, self.at_least))

    @property
    def min_two_sided(self) -> float:
        """Smallest two-sided value that these weights can give."""
        return min(1.0, 2 * self.min_one_sided)


def tails(weights: np.ndarray, positive: int) -> Tails:
    """Compute both tails of the sum of those weights that a fair coin makes positive.

    Parameters
    ----------
    weights : ndarray of int, shape (n,)
        Weights, above 0.
    positive : int
        Observed sum.

    Returns
    -------
    Tails
        Both tails.

    Notes
    -----
    Every one of the 2^n patterns of signs is as likely as any other when the two sides of a pair are
    exchangeable (Fisher, section 21). They are counted by convolution, weight by weight, so that ties and any
    weights are exact. Beyond 1000 weights the normal distribution of the same mean and variance, with
    continuity correction, is used instead.

    References
    ----------
    R. A. Fisher, The Design of Experiments, 1935.
    """
    weights = np.sort(np.asarray(weights, dtype=np.int64))
    min_one_sided = 0.5 ** len(weights)
    if not len(weights):
        return Tails(1.0, 1.0, 1.0, True)
    step = int(np.gcd.reduce(weights))
    weights, observed = weights // step, positive // step
    if len(weights) > EXACT_UP_TO:
        return _normal(weights, observed, min_one_sided)
    chances = np.zeros(int(weights.sum()) + 1)
    chances[0] = 1.0
    reach = 0
    for weight in weights.tolist():
        halved = chances[: reach + 1] / 2
        chances[: reach + 1] = halved
        chances[weight : reach + weight + 1] += halved
        reach += weight
    return Tails(float(chances[: observed + 1].sum()), float(chances[observed:].sum()), min_one_sided, True)


def _normal(weights: np.ndarray, observed: int, min_one_sided: float) -> Tails:
    scale = math.sqrt(2 * float((weights.astype(np.float64) ** 2).sum()) / 4)
    away = observed - weights.sum() / 2
    lower, upper = (math.erfc((sign * away - 0.5) / scale) / 2 for sign in (-1, 1))
    return Tails(lower, upper, min_one_sided, False)
