"""The state of a training at the end of an epoch, in one file from which it is resumed exactly.

Random numbers need no place in it: those of an epoch depend on the seed and the number of the epoch alone. In
place of Lightning's checkpoints: those have no fingerprint of settings and data that would refuse another training's.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from filelock import FileLock, Timeout

from models.atomic import atomic_write
from models.errors import InputError
from models.weights_file import UNREADABLE

FORMAT = "ctus-training-state"
VERSION = 2


@dataclass(frozen=True)
class TrainingState:
    """State of a training at the end of an epoch.

    Parameters
    ----------
    history : tuple of dict
        Measures of each epoch so far.
    weights : mapping
        State dict of the network.
    optimiser : mapping
        State dict of the optimiser.
    scaler : mapping
        State dict of the loss scaler.
    runtime_s : float
        Time in s that the training has taken.
    late : mapping
        State of the running average of the weights; empty where there is none.
    """

    history: tuple[dict[str, float], ...]
    weights: Mapping[str, Any]
    optimiser: Mapping[str, Any]
    scaler: Mapping[str, Any]
    runtime_s: float
    late: Mapping[str, Any] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True)
class TrainingFolder:
    """Files of one training that outlive its process: ``state.pt``, and ``model-<epoch>.pt`` of the kept epoch.

    An extension has the same files in a folder ``extended`` within, so that what it began from stays as it was.

    Parameters
    ----------
    path : Path
        The folder.
    fingerprint : str
        Fingerprint of the training that the files belong to.
    """

    path: Path
    fingerprint: str

    @property
    def state_path(self) -> Path:
        """File of the state."""
        return self.path / "state.pt"

    @property
    def extended(self) -> TrainingFolder:
        """Folder of the extension."""
        return TrainingFolder(self.path / "extended", self.fingerprint)

    def weights_path(self, epoch: int) -> Path:
        """Return the file of the weights of an epoch.

        Parameters
        ----------
        epoch : int
            Number of the epoch.

        Returns
        -------
        Path
            The file, which exists if that epoch is the one that is kept.
        """
        return self.path / f"model-{epoch}.pt"

    def save(self, state: TrainingState, kept: int) -> None:
        """Write the state; then remove the weights of epochs that are no longer kept.

        Parameters
        ----------
        state : TrainingState
            State to write.
        kept : int
            Number of the epoch whose weights are kept.
        """
        content = {field.name: getattr(state, field.name) for field in dataclasses.fields(state)}
        content |= {"format": FORMAT, "version": VERSION, "fingerprint": self.fingerprint}
        with atomic_write(self.state_path) as temporary:
            torch.save(content, temporary)
        for path in self.path.glob("model-*.pt"):
            if path != self.weights_path(kept):
                path.unlink()

    def load(self) -> TrainingState | None:
        """Read the state.

        Returns
        -------
        TrainingState or None
            None where there is none.

        Raises
        ------
        InputError
            If the file is damaged or of another training.
        """
        if not self.state_path.is_file():
            return None
        try:
            content = torch.load(self.state_path, map_location="cpu", weights_only=True)
        except UNREADABLE as error:
            raise InputError(
                f"{self._expected}, received a file that is damaged or of another kind"
            ) from error
        if not isinstance(content, dict) or (content.get("format"), content.get("version")) != (
            FORMAT,
            VERSION,
        ):
            raise InputError(f"{self._expected}, received a file of another kind or version")
        if content["fingerprint"] != self.fingerprint:
            raise InputError(f"{self._expected}, received that of other settings, data or another seed")
        return TrainingState(
            **{field.name: content[field.name] for field in dataclasses.fields(TrainingState)}
        )

    def clear(self) -> None:
        """Remove state and weights, those of an extension too."""
        for folder in (self.path, self.extended.path):
            for path in (folder / "state.pt", *folder.glob("model-*.pt")):
                path.unlink(missing_ok=True)

    @contextmanager
    def locked(self, on_wait: Callable[[], None] | None = None) -> Iterator[bool]:
        """Keep other processes away from the folder; while one is at work in it, wait.

        Nested splits have the same fold twice, and jobs that run side by side then train it at the same time.

        Parameters
        ----------
        on_wait : callable or None, optional
            Called once before waiting.

        Yields
        ------
        bool
            Whether another process was at work here: what it left is of this very training.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self.path / ".lock")
        waited = False
        try:
            lock.acquire(timeout=0)
        except Timeout:
            waited = True
            if on_wait is not None:
                on_wait()
            lock.acquire()
        try:
            yield waited
        finally:
            lock.release()

    @property
    def _expected(self) -> str:
        return f"{self.state_path}: expected the state of this very training (remove the file to start again)"
