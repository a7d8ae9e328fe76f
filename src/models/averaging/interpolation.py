"""Loss and DSC along the straight line between two networks' weights, and the barrier on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import torch
from torch import Tensor, nn

from models.array_types import Float64
from models.averaging.batch_statistics import reestimate_batch_statistics
from models.averaging.members import Member, combination, require_averageable
from models.errors import InputError
from models.weights import Weights


@dataclass(frozen=True)
class Evaluation:
    """Loss and DSC of a network on fixed data.

    Parameters
    ----------
    loss : float
        Mean loss.
    dsc : float
        Mean DSC over the images with a vessel, 0 to 1.
    """

    loss: float
    dsc: float


@dataclass(frozen=True, eq=False)
class BatchEvaluation:
    """Evaluation of state dicts of one architecture on fixed data.

    Parameters
    ----------
    network : Module
        Loads each state dict in turn; left in evaluation mode.
    loss : callable
        Loss of a batch from logits and masks; its mean over images is reported.
    batches : callable
        Returns images and masks (b, 1, h, w) anew at every call.
    statistics_batches : callable or None, optional
        Returns the images that statistics of batch normalisation are re-estimated on before every evaluation;
        None keeps those in the state dict.
    """

    network: nn.Module
    loss: Callable[[Tensor, Tensor], Tensor]
    batches: Callable[[], Iterable[tuple[Tensor, Tensor]]]
    statistics_batches: Callable[[], Iterable[Tensor]] | None = None

    @torch.no_grad()
    def __call__(self, weights: Weights) -> Evaluation:
        """Evaluate a state dict.

        Parameters
        ----------
        weights : Weights
            State dict of the architecture.

        Returns
        -------
        Evaluation
            Loss and DSC; a pixel is vessel where the logit is at least 0.

        Raises
        ------
        InputError
            If no image shows a vessel.
        """
        self.network.load_state_dict(dict(weights))
        if self.statistics_batches is not None:
            reestimate_batch_statistics(self.network, self.statistics_batches())
        self.network.eval()
        loss, images, overlaps = 0.0, 0, []
        for batch, masks in self.batches():
            logits = self.network(batch)
            loss += float(self.loss(logits, masks)) * len(batch)
            images += len(batch)
            predicted = (logits >= 0).flatten(1).double()
            reference = masks.flatten(1).double()
            both, shown = (predicted * reference).sum(1), reference.sum(1)
            overlaps += (2 * both / (predicted.sum(1) + shown))[shown > 0].tolist()
        if not overlaps:
            raise InputError(f"batches: expected an image with a vessel, found none in {images} images")
        return Evaluation(loss / images, float(np.mean(overlaps)))


@dataclass(frozen=True, eq=False)
class InterpolationPath:
    """Loss and DSC of ``(1 - alpha) first + alpha second``.

    Parameters
    ----------
    first, second : str
        Names of the networks.
    alphas : ndarray, shape (n,)
        Positions on the line from 0 to 1, both included.
    losses, dscs : ndarray, shape (n,)
        Mean loss and mean DSC at each position.
    """

    first: str
    second: str
    alphas: Float64[np.ndarray, " n"]
    losses: Float64[np.ndarray, " n"]
    dscs: Float64[np.ndarray, " n"]

    @property
    def loss_barrier(self) -> float:
        """Largest rise of the loss above the line between its ends; 0 for linearly connected networks."""
        return float(np.max(self.losses - self._between(self.losses)))

    @property
    def dsc_barrier(self) -> float:
        """Largest fall of the DSC below the line between its ends."""
        return float(np.max(self._between(self.dscs) - self.dscs))

    def _between(self, values: np.ndarray) -> np.ndarray:
        return np.asarray((1 - self.alphas) * values[0] + self.alphas * values[-1])


@dataclass(frozen=True, eq=False)
class PairwiseBarriers:
    """Paths between all pairs of networks, and their barriers as symmetric matrices.

    Parameters
    ----------
    names : tuple of str
        Names of the k networks, in the order of the matrices.
    paths : tuple of InterpolationPath
        Paths between all pairs, in the order of ``itertools.combinations``.
    """

    names: tuple[str, ...]
    paths: tuple[InterpolationPath, ...]

    @property
    def loss(self) -> Float64[np.ndarray, "k k"]:
        """Barriers of the loss, shape (k, k)."""
        return self._matrix(lambda path: path.loss_barrier)

    @property
    def dsc(self) -> Float64[np.ndarray, "k k"]:
        """Barriers of the DSC, shape (k, k)."""
        return self._matrix(lambda path: path.dsc_barrier)

    def _matrix(self, value: Callable[[InterpolationPath], float]) -> np.ndarray:
        matrix = np.zeros((len(self.names), len(self.names)))
        for (row, column), path in zip(combinations(range(len(self.names)), 2), self.paths, strict=True):
            matrix[row, column] = matrix[column, row] = value(path)
        return matrix


def interpolation_barriers(
    members: Sequence[Member], evaluate: Callable[[Weights], Evaluation], *, n_points: int = 11
) -> PairwiseBarriers:
    """Evaluate the straight lines between all pairs of networks.

    Every network is evaluated once. The networks may come from different starts: that is one thing a barrier
    explains.

    Parameters
    ----------
    members : sequence of Member
        At least two networks of one architecture.
    evaluate : callable
        Loss and DSC of a state dict, such as a ``BatchEvaluation``.
    n_points : int, optional
        Number of points on each line, both ends included; at least 3.

    Returns
    -------
    PairwiseBarriers
        The paths and their barriers.

    Raises
    ------
    InputError
        If there are fewer than two networks or three points, if networks differ in architecture, or a value
        is NaN.

    References
    ----------
    J. Frankle et al., ICML 2020; R. Entezari et al., ICLR 2022 (barrier against the linear interpolation of
    both ends).
    """
    if len(members) < 2:
        raise InputError(f"members: expected at least two networks, received {len(members)}")
    if n_points < 3:
        raise InputError(f"n_points: expected at least 3, both ends included, received {n_points}")
    require_averageable(members, same_start=False)
    ends = [_defined(evaluate(member.weights), member.name) for member in members]
    alphas = np.linspace(0.0, 1.0, n_points)
    paths = []
    for one, other in combinations(range(len(members)), 2):
        first, second = members[one], members[other]
        inner = [
            _defined(
                evaluate(combination([first.weights, second.weights], [1 - alpha, alpha])),
                f"{first.name} to {second.name} at {alpha:g}",
            )
            for alpha in alphas[1:-1]
        ]
        points = [ends[one], *inner, ends[other]]
        losses = np.array([point.loss for point in points], dtype=np.float64)
        dscs = np.array([point.dsc for point in points], dtype=np.float64)
        paths.append(InterpolationPath(first.name, second.name, alphas, losses, dscs))
    return PairwiseBarriers(tuple(member.name for member in members), tuple(paths))


def _defined(evaluation: Evaluation, of: str) -> Evaluation:
    if math.isnan(evaluation.loss) or math.isnan(evaluation.dsc):
        raise InputError(f"evaluation of {of}: expected a loss and a DSC, received {evaluation}")
    return evaluation
