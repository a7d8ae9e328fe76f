"""What a study hands back, and what it is given to work with."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Item = TypeVar("Item")


@dataclass(frozen=True)
class InputData:
    """A data set as a run used it: its name, a digest of its contents, and where it came from."""

    name: str
    digest: str
    source: str


@dataclass(frozen=True)
class Outcome:
    """The result of one job of a study, or of a whole sweep.

    ``metrics`` are finite or NaN scalars under the names of the metrics section; a failure is NaN or infinity here
    and is turned into a ``_failed`` count by the tracker. ``cases`` is the per-case table (one row a case or trial).
    ``history`` is one mapping of metrics per step (epoch, from 0). ``tables`` are small result tables that end the
    terminal's output. ``figures`` are matplotlib figures by file stem. ``findings`` are plain sentences.
    ``inputs`` are the data sets used. Files that a
    study leaves in its workspace are tracked as they are.
    """

    metrics: Mapping[str, float] = field(default_factory=dict)
    cases: pd.DataFrame | None = None
    history: tuple[Mapping[str, float], ...] = ()
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    tags: Mapping[str, str] = field(default_factory=dict)
    inputs: tuple[InputData, ...] = ()


@dataclass(frozen=True)
class JobResult:
    """A finished job as the summary of a sweep sees it: its configuration, metrics and per-case table.

    ``workspace`` is the folder its files lie in. It holds the same whether the job ran just now or was resumed.
    ``choices`` are the settings by which its point of the sweep differs from others, as the command line has them.
    """

    config: Mapping[str, Any]
    metrics: Mapping[str, float]
    cases: pd.DataFrame | None
    workspace: Path
    run_id: str | None = None
    choices: Mapping[str, str] = field(default_factory=dict)


class Progress(Protocol):
    """How a study says how far it is."""

    def track(self, items: Iterable[Item], description: str, total: int | None = None) -> Iterator[Item]:
        """Pass ``items`` through while a bar with the time left advances."""
        ...

    def note(self, text: str) -> None:
        """Print one line above the bar."""
        ...


class Silent:
    """Progress that shows nothing, for tests and for use as a library."""

    def track(self, items: Iterable[Item], description: str, total: int | None = None) -> Iterator[Item]:
        """Pass ``items`` through."""
        del description, total
        yield from items

    def note(self, text: str) -> None:
        """Drop the line."""
        del text
