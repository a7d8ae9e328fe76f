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
    """A data set as a run used it: its name, a digest of its contents, and where it came from.

    Parameters
    ----------
    name : str
        Name of the data set.
    digest : str
        Digest of its contents.
    source : str
        Where it came from.
    """

    name: str
    digest: str
    source: str


@dataclass(frozen=True)
class Outcome:
    """The result of one job of a study, or of a whole sweep.

    A metric that is NaN or infinite is turned into a ``_failed`` count by the tracker. Files that a study leaves in its
    workspace are tracked as they are.

    Parameters
    ----------
    metrics : Mapping[str, float], optional
        Scalars by metric name; NaN or infinite for a failure.
    cases : pd.DataFrame or None, optional
        One row a case or trial; None if the study has none.
    history : tuple[Mapping[str, float], ...], optional
        Metrics of each epoch or step, from 0.
    tables : Mapping[str, pd.DataFrame], optional
        Small result tables by title, shown at the end of the terminal's output.
    figures : Mapping[str, Figure], optional
        Figures by file stem.
    findings : tuple[str, ...], optional
        Results as plain sentences.
    tags : Mapping[str, str], optional
        Tags of the tracked run.
    inputs : tuple[InputData, ...], optional
        Data sets that were used.
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

    It holds the same whether the job ran just now or was resumed.

    Parameters
    ----------
    config : Mapping[str, Any]
        The resolved configuration of the job.
    metrics : Mapping[str, float]
        Its scalar metrics.
    cases : pd.DataFrame or None
        Its table of cases; None if it has none.
    workspace : Path
        Folder of its files.
    run_id : str or None, optional
        Id of its tracked run; None if it is not tracked.
    choices : Mapping[str, str], optional
        Settings by which its sweep point differs from others.
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
        """Pass ``items`` through while a bar with the time left advances.

        Parameters
        ----------
        items : Iterable[Item]
            What is worked through.
        description : str
            Text before the bar.
        total : int or None, optional
            Number of items; None if it is known from ``items`` or unknown.

        Returns
        -------
        Iterator[Item]
            The items.
        """
        ...

    def note(self, text: str) -> None:
        """Print one line above the bar.

        Parameters
        ----------
        text : str
            Line to print.
        """
        ...


class Silent:
    """Progress that shows nothing, for tests and for use as a library."""

    def track(self, items: Iterable[Item], description: str, total: int | None = None) -> Iterator[Item]:
        """Pass ``items`` through.

        Parameters
        ----------
        items : Iterable[Item]
            What is worked through.
        description : str
            Text before the bar.
        total : int or None, optional
            Number of items; None if it is known from ``items`` or unknown.

        Returns
        -------
        Iterator[Item]
            The items.
        """
        del description, total
        yield from items

    def note(self, text: str) -> None:
        """Drop the line.

        Parameters
        ----------
        text : str
            Line to print.
        """
        del text
