"""Temperature scaling of logits, with or without a bias, fitted in passes over data of any size."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import minimize

from models.array_types import Float, Float32, Float64, Shaped
from models.errors import InputError

# Probabilities nearer to 0 and 1 have no distinct logit in 32 bits.
MIN_PROBABILITY = 2.0**-24
# Bounds of the factor of the logits, 1 / temperature.
FACTORS = (1e-3, 1e3)
_BELOW_HALF = np.nextafter(np.float32(0.5), np.float32(0.0))

# Returns batches of logits and masks of the same shape; called for every pass.
Batches = Callable[[], Iterable[tuple[np.ndarray, np.ndarray]]]


@dataclass(frozen=True)
class TemperatureScaling:
    """Probabilities ``sigmoid(logit / temperature + bias)`` from a binary network's logits.

    With a bias of 0 it is temperature scaling, with another Platt scaling. For an ensemble, the logits are
    those of its mean probability (``logits_of``).

    Parameters
    ----------
    temperature : float, optional
        Above 0; above 1 softens.
    bias : float, optional
        Added to the scaled logits.

    Raises
    ------
    InputError
        If the temperature is not positive or a value is not finite.

    References
    ----------
    C. Guo et al., ICML 2017; J. Platt, 1999.
    """

    temperature: float = 1.0
    bias: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.temperature < math.inf:
            raise InputError(f"temperature: expected a positive number, received {self.temperature}")
        if not math.isfinite(self.bias):
            raise InputError(f"bias: expected a finite number, received {self.bias}")

    def __call__(self, logits: Float[np.ndarray, "*any"]) -> Float32[np.ndarray, "*any"]:
        """Compute calibrated probabilities.

        Without a bias, a probability is 0.5 or more exactly where the logit is 0 or more, so that no
        temperature changes the mask at 0.5, rounding included.

        Parameters
        ----------
        logits : ndarray
            Logits of any shape.

        Returns
        -------
        ndarray of float32
            Probabilities of the same shape, 0 to 1.
        """
        scaled = torch.tensor(np.asarray(logits, dtype=np.float32)) / self.temperature + self.bias
        probability = torch.sigmoid(scaled).numpy()
        if self.bias == 0:
            # A small negative logit must not be rounded up to a half.
            np.minimum(probability, _BELOW_HALF, out=probability, where=np.asarray(logits) < 0)
        return np.asarray(probability)

    def threshold_before(self, threshold: float) -> float:
        """Compute the uncalibrated probability that becomes a given calibrated one.

        Parameters
        ----------
        threshold : float
            Calibrated probability, above 0 and below 1.

        Returns
        -------
        float
            Uncalibrated probability.

        Raises
        ------
        InputError
            If the threshold is out of range.
        """
        if not 0 < threshold < 1:
            raise InputError(f"threshold: expected above 0 and below 1, received {threshold}")
        logit = self.temperature * (math.log(threshold) - math.log1p(-threshold) - self.bias)
        return float(torch.sigmoid(torch.tensor(logit, dtype=torch.float64)))


@dataclass(frozen=True)
class FittedTemperature:
    """Result of ``fit_temperature``.

    Parameters
    ----------
    scaling : TemperatureScaling
        The calibration.
    nll_before, nll_after : float
        Mean negative log-likelihood of a pixel on the data of the fit.
    pixels : int
        Number of pixels.
    passes : int
        Number of passes over the data.
    """

    scaling: TemperatureScaling
    nll_before: float
    nll_after: float
    pixels: int
    passes: int


def logits_of(probability: Float[np.ndarray, "*any"]) -> Float32[np.ndarray, "*any"]:
    """Compute the logits of probabilities.

    Parameters
    ----------
    probability : ndarray
        Probabilities, 0 to 1; clipped by ``MIN_PROBABILITY``, so that logits are finite.

    Returns
    -------
    ndarray of float32
        Logits of the same shape.
    """
    clipped = np.clip(np.asarray(probability, np.float64), MIN_PROBABILITY, 1 - MIN_PROBABILITY)
    return np.asarray(np.log(clipped) - np.log1p(-clipped), dtype=np.float32)


def fit_temperature(
    batches: Batches, *, with_bias: bool = False, max_iter: int = 100, tol: float = 1e-7
) -> FittedTemperature:
    """Fit temperature (and bias) by minimal negative log-likelihood, by L-BFGS on exact sums over all pixels.

    The problem is convex in 1 / temperature and bias; every evaluation is one pass over the batches in 64
    bits and the memory of one batch, so that neither the size nor the order of batches changes the result but
    for rounding.

    Parameters
    ----------
    batches : callable
        Returns the logits (any shape, floating) and masks of 0 and 1 (same shape) anew at every call.
    with_bias : bool, optional
        Whether a bias is fitted too.
    max_iter : int, optional
        Largest number of iterations of L-BFGS.
    tol : float, optional
        Largest component of the gradient, per pixel, at which it stops.

    Returns
    -------
    FittedTemperature
        The calibration and its likelihood.

    Raises
    ------
    InputError
        If there are no pixels or only one class, if shapes, labels or logits are not as expected, if the
        likelihood has no maximum (the logits separate the classes perfectly, or have the wrong sign), or if
        ``max_iter`` is reached.
    """
    problem = _Likelihood(batches, with_bias)
    start = np.array([1.0, 0.0])[: 1 + with_bias]
    nll_before, _ = problem(start)
    problem.require_overlap()
    bounds = [FACTORS, (None, None)][: 1 + with_bias]
    found = minimize(
        problem,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": max_iter, "gtol": tol, "ftol": 1e-15},
    )
    factor = float(found.x[0])
    if not 1.001 * FACTORS[0] < factor < 0.999 * FACTORS[1]:
        raise InputError(
            f"logits: expected those of a likelihood with a maximum at a temperature of {1 / FACTORS[1]:g} to "
            f"{1 / FACTORS[0]:g}, found it rising beyond {1 / factor:g}"
        )
    if found.nit >= max_iter:
        raise InputError(f"max_iter: expected enough for the fit to converge, received {max_iter}")
    bias = float(found.x[1]) if with_bias else 0.0
    return FittedTemperature(
        TemperatureScaling(1 / factor, bias),
        float(nll_before),
        float(found.fun),
        problem.pixels,
        problem.passes,
    )


class _Likelihood:
    """Mean negative log-likelihood of a pixel and its gradient in (1 / temperature, bias)."""

    def __init__(self, batches: Batches, with_bias: bool) -> None:
        self.batches, self.with_bias = batches, with_bias
        self.pixels = self.passes = self.vessel = 0
        # The range of logits on which the classes overlap, in the first pass.
        self.min_vessel_logit, self.max_background_logit = math.inf, -math.inf

    def __call__(self, parameters: Float64[np.ndarray, " p"]) -> tuple[float, Float64[np.ndarray, " p"]]:
        factor, bias = float(parameters[0]), float(parameters[1]) if self.with_bias else 0.0
        sums = np.zeros(3)
        pixels = vessel = 0
        for logits, masks in self.batches():
            values, labels = _checked(logits, masks, first=not self.passes)
            if not self.passes:
                self._note_ranges(values, labels)
            scaled = factor * values + bias
            excess = torch.sigmoid(scaled) - labels
            loss = torch.nn.functional.softplus(scaled) - labels * scaled
            sums += [float(loss.sum()), float((excess * values).sum()), float(excess.sum())]
            pixels += values.numel()
            vessel += int(labels.sum())
        if not pixels:
            raise InputError("batches: expected logits and masks, received none")
        if self.passes and (pixels, vessel) != (self.pixels, self.vessel):
            raise InputError(
                f"batches: expected the same data in every pass, {self.pixels} pixels with {self.vessel} of vessel, "
                f"received {pixels} with {vessel}"
            )
        self.pixels, self.vessel = pixels, vessel
        self.passes += 1
        return sums[0] / pixels, sums[1 : len(parameters) + 1] / pixels

    def _note_ranges(self, values: torch.Tensor, labels: torch.Tensor) -> None:
        vessel, background = values[labels == 1], values[labels == 0]
        if len(vessel):
            self.min_vessel_logit = min(self.min_vessel_logit, float(vessel.min()))
        if len(background):
            self.max_background_logit = max(self.max_background_logit, float(background.max()))

    def require_overlap(self) -> None:
        """Raise InputError if there is one class only, or the likelihood rises for ever as the temperature falls."""
        if self.vessel in (0, self.pixels):
            raise InputError(
                f"masks: expected pixels of vessel and of background, found {self.vessel} of {self.pixels} of vessel"
            )
        separated = self.min_vessel_logit >= self.max_background_logit
        if not self.with_bias:
            separated = self.min_vessel_logit >= 0 >= self.max_background_logit
        if separated:
            raise InputError(
                "logits: expected some on the wrong side, found vessel and background separated perfectly "
                f"({self.min_vessel_logit:g} and up, {self.max_background_logit:g} and down)"
            )


def _checked(
    logits: Shaped[np.ndarray, "..."], masks: Shaped[np.ndarray, "..."], first: bool
) -> tuple[torch.Tensor, torch.Tensor]:
    """Both flat and in 64 bits; values are looked at in the first pass alone."""
    if logits.shape != masks.shape:
        raise InputError(f"masks: expected the logits' shape {logits.shape}, received {masks.shape}")
    values = torch.tensor(np.asarray(logits, dtype=np.float64)).reshape(-1)
    labels = torch.tensor(np.asarray(masks, dtype=np.float64)).reshape(-1)
    if first and not bool(torch.isfinite(values).all()):
        raise InputError("logits: expected finite numbers, received others")
    if first and not bool(((labels == 0) | (labels == 1)).all()):
        raise InputError("masks: expected 0 and 1, received other values")
    return values, labels
