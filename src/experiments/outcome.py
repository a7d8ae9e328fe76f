"""What a study hands back, and what it is given to work with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from registration.brief import brief_repr

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Item = TypeVar("Item")


@dataclass(frozen=True)
class InputData:
    """Data set as a run used it.

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
    """Result of one job of a study, or of a whole sweep.

    Files that a study leaves in its workspace are tracked as they are.

    Parameters
    ----------
    metrics : Mapping[str, float], optional
        Scalars by the name of the metric; NaN or infinity stands for a failure, which the tracker turns into
        a ``_failed`` count.
    cases : pandas.DataFrame or None, optional
        Per-case table, one row a case or trial; None if there is none.
    history : tuple of Mapping[str, float], optional
        Metrics of each step (epoch), from 0.
    tables : Mapping[str, pd.DataFrame], optional
        Small result tables by title, which end the terminal's output.
    figures : Mapping[str, Figure], optional
        Matplotlib figures by file stem.
    findings : tuple of str, optional
        Plain sentences.
    tags : Mapping[str, str], optional
        Text by the name of the tag.
    inputs : tuple of InputData, optional
        Data sets used.
    files : Mapping[str, callable], optional
        What writes a further file, given its path, by the file's name. A summary, which has no workspace, leaves files
        this way.
    refused : tuple of str, optional
        Inputs that were left out because they are not what they must be, a sentence each; all others were done.
    """

    metrics: Mapping[str, float] = field(default_factory=dict)
    cases: pd.DataFrame | None = None
    history: tuple[Mapping[str, float], ...] = ()
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    tags: Mapping[str, str] = field(default_factory=dict)
    inputs: tuple[InputData, ...] = ()
    files: Mapping[str, Callable[[Path], None]] = field(default_factory=dict)
    refused: tuple[str, ...] = ()

    __repr__ = brief_repr


@dataclass(frozen=True)
class JobResult:
    """Finished job as the summary of a sweep sees it; the same whether the job ran just now or was resumed.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the job as plain data.
    metrics : Mapping[str, float]
        Scalars by the name of the metric.
    cases : pandas.DataFrame or None
        Per-case table; None if there is none.
    workspace : Path
        Folder of the job's files.
    run_id : str or None, optional
        The tracker's id of the run; None if it is not tracked.
    choices : Mapping[str, str], optional
        Settings by which its sweep point differs from others, as the command line has them.
    """

    config: Mapping[str, Any]
    metrics: Mapping[str, float]
    cases: pd.DataFrame | None
    workspace: Path
    run_id: str | None = None
    choices: Mapping[str, str] = field(default_factory=dict)

    __repr__ = brief_repr


class Progress(Protocol):
    """How a study says how far it is."""

    def track(self, items: Iterable[Item], description: str, total: int | None = None) -> Iterator[Item]:
        """Pass items through while a bar with the time left advances.

        Parameters
        ----------
        items : iterable of Item
            Items to pass through.
        description : str
            Text before the bar.
        total : int or None, optional
            Number of items; None if it is known from ``items`` or unknown.

        Yields
        ------
        Item
            Each item.
        """
        ...

    def note(self, text: str) -> None:
        """Print one line above the bar.

        Parameters
        ----------
        text : str
            The line.
        """
        ...


class Silent:
    """Progress that shows nothing, for tests and for use as a library."""

    def track(self, items: Iterable[Item], description: str, total: int | None = None) -> Iterator[Item]:
        """Pass items through and show nothing.

        Parameters
        ----------
        items : iterable of Item
            Items to pass through.
        description : str
            Has no effect.
        total : int or None, optional
            Has no effect.

        Yields
        ------
        Item
            Each item.
        """
        del description, total
        yield from items

    def note(self, text: str) -> None:
        """Drop the line.

        Parameters
        ----------
        text : str
            The line.
        """
        del text
