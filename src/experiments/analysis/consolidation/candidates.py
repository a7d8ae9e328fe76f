"""The networks and ensembles that one model can be made of, built from the folds' networks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor, nn

from experiments.analysis.consolidation.predictions import PreparedCases
from models.averaging import (
    BatchEvaluation,
    Member,
    PairwiseBarriers,
    WeightMatching,
    Weights,
    align_all,
    channel_ties,
    greedy_average,
    interpolation_barriers,
    reestimate_batch_statistics,
    repair,
    uniform_average,
)
from models.averaging.batch_statistics import batch_normalisations
from models.errors import InputError
from models.training.losses import Loss

MEAN_FOLD, BEST_FOLD = "mean fold", "best fold"
UNIFORM, BATCH_NORM, GREEDY, ALIGNED = "uniform", "uniform + batch norm", "greedy", "aligned"
ENSEMBLE, NETWORKS, DISTILLED = "ensemble of folds", "ensemble of networks", "distilled"
AVERAGES = (UNIFORM, BATCH_NORM, GREEDY, ALIGNED)
ORDER = (MEAN_FOLD, BEST_FOLD, *AVERAGES, DISTILLED, ENSEMBLE, NETWORKS)
NO_BATCH_STATISTICS = "no batch statistics: these networks have no batch normalisation"


@dataclass(frozen=True, eq=False)
class Candidate:
    """A network, or several whose probabilities are averaged.

    Parameters
    ----------
    name : str
        Name in tables.
    members : tuple of Member
        Its networks.
    """

    name: str
    members: tuple[Member, ...]

    @property
    def megabytes(self) -> float:
        """Size of its weights in MB (1e6 bytes)."""
        sizes = [t.numel() * t.element_size() for member in self.members for t in member.weights.values()]
        return sum(sizes) / 1e6


@dataclass(frozen=True, eq=False)
class AveragingInputs:
    """What averages are made and chosen with.

    Parameters
    ----------
    selection : PreparedCases
        Cases of selection groups, on which greedy averages and barriers are evaluated.
    training : tuple of PreparedCases
        Cases of the folds, whose images statistics are re-estimated on.
    loss : Loss
        Loss that barriers are of.
    batch_size : int
        Number of cases in a batch.
    device : str, optional
        ``cpu`` or ``cuda``.
    statistics_cases : int or None, optional
        Largest number of training cases that statistics are estimated on, taken evenly; None for all.
    """

    selection: PreparedCases
    training: tuple[PreparedCases, ...]
    loss: Loss
    batch_size: int
    device: str = "cpu"
    statistics_cases: int | None = None

    def images(self) -> Iterator[Tensor]:
        """Stream the training images that statistics are estimated on.

        Yields
        ------
        Tensor, shape (b, 1, s, s)
            Normalised images.
        """
        for cases in self.training:
            most = self.statistics_cases
            indices = _evenly(len(cases), None if most is None else -(-most // len(self.training)))
            for images, _ in cases.batches(self.batch_size, indices):
                yield images.to(self.device)

    def evaluation(self, network: nn.Module, max_cases: int | None = None) -> BatchEvaluation:
        """Set up the evaluation of state dicts on the selection cases.

        Parameters
        ----------
        network : Module
            Network that the state dicts are loaded into.
        max_cases : int or None, optional
            Largest number of cases, taken evenly; None for all.

        Returns
        -------
        BatchEvaluation
            The evaluation, with statistics of batch normalisation re-estimated where there are some.
        """
        indices = _with_vessel(self.selection, max_cases)

        def batches() -> Iterable[tuple[Tensor, Tensor]]:
            for images, masks in self.selection.batches(self.batch_size, indices):
                yield images.to(self.device), masks.to(self.device)

        refreshed = self.images if batch_normalisations(network) else None
        return BatchEvaluation(network, self.loss, batches, refreshed)


def averages(
    members: Sequence[Member], inputs: AveragingInputs, *, aligned: bool
) -> tuple[list[Candidate], tuple[str, ...]]:
    """Average the folds' networks in every way there is.

    Parameters
    ----------
    members : sequence of Member
        Networks of the folds.
    inputs : AveragingInputs
        Data that averages are made and chosen with.
    aligned : bool
        Whether an average of aligned networks is made too.

    Returns
    -------
    candidates : list of Candidate
        Uniform, uniform with re-estimated batch statistics (where there are some), greedy and aligned average.
    notes : tuple of str
        What is not there and why, and which networks the greedy average holds.

    Raises
    ------
    models.errors.InputError
        If the networks can't be averaged: other architectures or other starts.
    """
    recipe = members[0].recipe
    network = recipe().to(inputs.device)
    uniform = uniform_average(members)
    found, notes = [Candidate(UNIFORM, (Member(UNIFORM, recipe, uniform),))], []
    refresh = None
    if batch_normalisations(network):
        refresh = _Refresh(network, inputs)
        found.append(Candidate(BATCH_NORM, (Member(BATCH_NORM, recipe, refresh(uniform)),)))
    else:
        notes.append(f"{BATCH_NORM}: {NO_BATCH_STATISTICS}.")
    evaluate = _without_refresh(inputs.evaluation(network))
    greedy = greedy_average(members, lambda weights: evaluate(weights).dsc, refresh=refresh)
    found.append(Candidate(GREEDY, (Member(GREEDY, recipe, greedy.weights),)))
    notes.append(f"greedy: {', '.join(greedy.members)}, in this order.")
    if aligned:
        weights, refusal = _aligned(members, network, inputs)
        if weights is None:
            notes.append(f"aligned: not made ({refusal}).")
        else:
            found.append(Candidate(ALIGNED, (Member(ALIGNED, recipe, weights),)))
    return found, tuple(notes)


def barriers(
    members: Sequence[Member], inputs: AveragingInputs, *, n_points: int, max_cases: int | None
) -> PairwiseBarriers:
    """Evaluate the lines between all pairs of the folds' networks on selection cases.

    Parameters
    ----------
    members : sequence of Member
        Networks of the folds.
    inputs : AveragingInputs
        Data to evaluate on.
    n_points : int
        Number of points on each line, both ends included.
    max_cases : int or None
        Largest number of cases that are evaluated; None for all.

    Returns
    -------
    PairwiseBarriers
        Loss and DSC along the lines.
    """
    network = members[0].recipe().to(inputs.device)
    return interpolation_barriers(members, inputs.evaluation(network, max_cases), n_points=n_points)


@dataclass(frozen=True, eq=False)
class _Refresh:
    """Weights with statistics of batch normalisation re-estimated on the training images."""

    network: nn.Module
    inputs: AveragingInputs

    def __call__(self, weights: Weights) -> dict[str, Tensor]:
        self.network.load_state_dict(dict(weights))
        reestimate_batch_statistics(self.network, self.inputs.images())
        return {name: tensor.detach().cpu().clone() for name, tensor in self.network.state_dict().items()}


def _without_refresh(evaluation: BatchEvaluation) -> BatchEvaluation:
    """The evaluation of weights as they are."""
    return BatchEvaluation(evaluation.network, evaluation.loss, evaluation.batches)


def _aligned(
    members: Sequence[Member], network: nn.Module, inputs: AveragingInputs
) -> tuple[dict[str, Tensor] | None, str]:
    """Weights of the repaired average of aligned networks; none with the reason if they can't be aligned."""
    try:
        ties = channel_ties(members[0].recipe)
    except InputError as refusal:
        return None, str(refusal)
    weights = align_all([member.weights for member in members], ties, WeightMatching())
    moved = [Member(member.name, member.recipe, each) for member, each in zip(members, weights, strict=True)]
    average = uniform_average(moved, same_start=False)
    repaired = repair(network, average, weights, inputs.images)
    return {name: tensor.cpu() for name, tensor in repaired.items()}, ""


def _evenly(count: int, most: int | None) -> list[int] | None:
    """Places of so many of a number of things, evenly over their order; None for all."""
    if most is None or count <= most:
        return None
    return [place * count // most for place in range(most)]


def _with_vessel(cases: PreparedCases, most: int | None) -> list[int] | None:
    """Places of so many cases with a vessel, evenly over the order; None for all cases."""
    if most is None or len(cases) <= most:
        return None
    shown = np.flatnonzero(cases.masks.reshape(len(cases), -1).any(axis=1))
    chosen = _evenly(len(shown), most)
    return [int(shown[place]) for place in (range(len(shown)) if chosen is None else chosen)]
