"""What a run has been given, kept until the tracker has it: so that it can be delivered later, whole and in order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from experiments.outcome import InputData

Point = tuple[str, float, int, int]


@dataclass(frozen=True)
class RunStart:
    """What a run was begun with.

    Parameters
    ----------
    experiment : str
        Name of the experiment.
    name : str
        Name of the run.
    parent_id : str or None
        Id of the run above; None if there is none.
    tags : Mapping[str, str]
        Tags by name.
    start_ms : int
        Start in ms since 1970.
    """

    experiment: str
    name: str
    parent_id: str | None
    tags: Mapping[str, str]
    start_ms: int


@dataclass
class Written:
    """Everything that was logged on a run so far, whether the tracker took it or not.

    Parameters
    ----------
    params : dict[str, str], optional
        Parameters by name.
    points : list of tuple, optional
        Name, value, time in ms and step of every metric.
    tags : dict[str, str], optional
        Tags by name.
    inputs : list of InputData, optional
        Data sets that were used.
    texts : dict[str, str], optional
        Texts by the name of their file.
    files : list of tuple of str, optional
        Folder and name of every file.
    status : str or None, optional
        How the run ended: FINISHED, FAILED or KILLED; None while it runs.
    end_ms : int or None, optional
        End in ms since 1970; None while it runs.
    """

    params: dict[str, str] = field(default_factory=dict)
    points: list[Point] = field(default_factory=list)
    tags: dict[str, str] = field(default_factory=dict)
    inputs: list[InputData] = field(default_factory=list)
    texts: dict[str, str] = field(default_factory=dict)
    files: list[tuple[str, str]] = field(default_factory=list)
    status: str | None = None
    end_ms: int | None = None

    def add_files(self, folder: Path, names: Iterable[str]) -> None:
        """Note files, which stay where they are.

        Parameters
        ----------
        folder : Path
            Folder that holds them.
        names : iterable of str
            Their names, from that folder on.
        """
        self.files += [(str(folder), name) for name in names]

    def text_of(self, name: str) -> str:
        """The content of a text that was logged as such or as a file.

        Parameters
        ----------
        name : str
            Name of the file among the run's artifacts.

        Returns
        -------
        str
            The content; empty where there is none.
        """
        if name in self.texts:
            return self.texts[name]
        path = self.file_of(name)
        return path.read_text(encoding="utf-8") if path is not None else ""

    def file_of(self, name: str) -> Path | None:
        """The file of that name.

        Parameters
        ----------
        name : str
            Name among the run's artifacts.

        Returns
        -------
        Path or None
            The file where it lies; None if none was logged, or it is gone.
        """
        paths = [Path(folder) / each for folder, each in self.files if each == name]
        return next((path for path in reversed(paths) if path.is_file()), None)
