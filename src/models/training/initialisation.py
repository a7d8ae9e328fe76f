"""The weights that all folds of a training start from: random ones of one seed, or those of a trained network.

Networks whose weights are to be averaged have to start from the same weights (J. Frankle et al., ICML 2020). Averages
of fine-tuned networks rely on a start that is trained already (M. Wortsman et al., ICML 2022).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Protocol, runtime_checkable

import torch
from torch import nn

from models.checkpoint import Checkpoint
from models.errors import InputError
from models.networks.registry import NetworkRecipe, settings_of
from models.seeds import WEIGHTS, seed_of
from models.training.training_data import TrainingData, from_notes
from models.weights import Weights, weights_digest


@dataclass(frozen=True, eq=False)
class Start:
    """Weights that a training starts from.

    Parameters
    ----------
    weights : Weights
        State dict.
    source : str
        What they are, in words.
    trained_on : tuple of TrainingData, optional
        Data sets that they have learnt from; none for random weights.
    """

    weights: Weights
    source: str
    trained_on: tuple[TrainingData, ...] = ()

    @cached_property
    def digest(self) -> str:
        """``weights_digest`` of the weights."""
        return weights_digest(self.weights)

    def network(self, model: NetworkRecipe) -> nn.Module:
        """Build a network with these weights; torch's own random stream is left as it was.

        Parameters
        ----------
        model : NetworkRecipe
            Architecture that the weights are of.

        Returns
        -------
        nn.Module
            Network in training mode.
        """
        with torch.random.fork_rng():
            network = model()
        network.load_state_dict(dict(self.weights))
        return network


@runtime_checkable
class Initialisation(Protocol):
    """Choice of the weights that a training starts from: a frozen dataclass."""

    name: ClassVar[str]

    def require_fit(self, model: NetworkRecipe) -> None:
        """Refuse an architecture that the weights are not of.

        Parameters
        ----------
        model : NetworkRecipe
            Architecture to train.
        """
        ...

    def require_unseen(self, data: Sequence[TrainingData]) -> None:
        """Refuse data that the weights have learnt from.

        Parameters
        ----------
        data : sequence of TrainingData
            Data sets whose cases are trained on or scored.
        """
        ...

    def __call__(self, model: NetworkRecipe, seed: int) -> Start:
        """Get the weights.

        Parameters
        ----------
        model : NetworkRecipe
            Architecture to train.
        seed : int
            Seed of the training.

        Returns
        -------
        Start
            The same for every fold.
        """
        ...


@dataclass(frozen=True)
class SharedRandom:
    """Random weights that depend on the seed of the training alone, the same for every fold."""

    name: ClassVar[str] = "shared_random"

    def require_fit(self, model: NetworkRecipe) -> None:
        """Accept every architecture.

        Parameters
        ----------
        model : NetworkRecipe
            Architecture to train.
        """

    def require_unseen(self, data: Sequence[TrainingData]) -> None:
        """Accept all data.

        Parameters
        ----------
        data : sequence of TrainingData
            Data sets whose cases are trained on or scored.
        """

    def __call__(self, model: NetworkRecipe, seed: int) -> Start:
        """Draw the weights; torch's own random stream is left as it was.

        Parameters
        ----------
        model : NetworkRecipe
            Architecture to train.
        seed : int
            Seed of the training.

        Returns
        -------
        Start
            The same for every fold.
        """
        with torch.random.fork_rng():
            torch.manual_seed(seed_of(seed, WEIGHTS))
            return Start(model().state_dict(), f"random weights of seed {seed}")


@dataclass(frozen=True)
class Pretrained:
    """Weights of a trained network of the same architecture.

    Parameters
    ----------
    path : str or Path or None
        Checkpoint, such as the ``model.pt`` that ``study=pretrain`` leaves.
    allow_seen_data : bool, optional
        Whether the start may have learnt from the data set that is now divided into folds, or from data it does not
        name. Scores on cases that the start has seen are no scores on unseen cases.
    """

    path: str | Path | None = None
    allow_seen_data: bool = False

    name: ClassVar[str] = "pretrained"

    @cached_property
    def checkpoint(self) -> Checkpoint:
        """Content of the file; InputError if there is none or it is of another kind."""
        if self.path is None:
            raise InputError(
                "init.path: expected the model.pt of a trained network, received null (study=pretrain makes one)"
            )
        return Checkpoint.load(Path(self.path).expanduser())

    @property
    def trained_on(self) -> tuple[TrainingData, ...]:
        """Data sets that the start has learnt from; none where the file does not say."""
        return from_notes(self.checkpoint.notes) or ()

    def require_fit(self, model: NetworkRecipe) -> None:
        """Refuse another architecture than that of the file.

        Parameters
        ----------
        model : NetworkRecipe
            Architecture to train.

        Raises
        ------
        InputError
            If the network or one of its settings differs, or the file can't be read.
        """
        own = self.checkpoint.recipe
        if own.name != model.name:
            raise InputError(f"init.path: expected a {model.name}, received a {own.name} ({self.path})")
        expected, received = settings_of(model), settings_of(own)
        for setting in sorted(expected):
            if expected[setting] != received[setting]:
                raise InputError(
                    f"init.path: expected a {model.name} with {setting} {expected[setting]} as the one to train, "
                    f"received {setting} {received[setting]} ({self.path})"
                )

    def require_unseen(self, data: Sequence[TrainingData]) -> None:
        """Refuse a start that has learnt from data that is now to be divided into folds.

        Parameters
        ----------
        data : sequence of TrainingData
            Data sets whose cases are trained on or scored.

        Raises
        ------
        InputError
            If the start has seen one of them or does not say what it has seen, unless ``allow_seen_data`` is set.
        """
        if self.allow_seen_data:
            return
        seen = self.trained_on
        if not seen:
            raise InputError(
                f"init.path: expected a network that names the data it was trained on, received {self.path} "
                "without such a note (init.allow_seen_data=true takes it still)"
            )
        both = next((each for each in data if any(each.overlaps(one) for one in seen)), None)
        if both is not None:
            raise InputError(
                f"init.path: expected a network trained on other data than {both.label}, received {self.path}, "
                "which was trained on it and may know cases that score it (init.allow_seen_data=true takes it still)"
            )

    def __call__(self, model: NetworkRecipe, seed: int) -> Start:
        """Take the weights of the file.

        Parameters
        ----------
        model : NetworkRecipe
            Architecture to train.
        seed : int
            Seed of the training; not used.

        Returns
        -------
        Start
            The same for every fold and seed.

        Raises
        ------
        InputError
            If the architecture differs or the file can't be read.
        """
        self.require_fit(model)
        labels = ", ".join(each.label for each in self.trained_on) or "unknown data"
        return Start(self.checkpoint.weights, f"weights trained on {labels}", self.trained_on)


def initial_network(model: NetworkRecipe, seed: int) -> nn.Module:
    """Build the network with the random weights that every fold of a seed starts from.

    Parameters
    ----------
    model : NetworkRecipe
        Architecture.
    seed : int
        Seed of the training.

    Returns
    -------
    nn.Module
        The untrained network.
    """
    return SharedRandom()(model, seed).network(model)
