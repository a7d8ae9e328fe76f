"""What the terminal shows: bars with the time left while work goes on, then what was found and where it lies."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterable, Iterator, Sized
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rich import box
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    import pandas as pd

Item = TypeVar("Item")
# Without a terminal (a log file, CI) a bar can't be redrawn; a line now and then says the same.
LINE_EVERY_S = 15.0
WIDEST_TABLE = 160


class TerminalProgress:
    """Progress as a bar on a terminal, as a line now and then elsewhere; ``prefix`` comes before every line."""

    def __init__(self, console: Console | None = None, prefix: str = "") -> None:
        self.console = console or Console(stderr=True)
        self.prefix = prefix
        self._display: Progress | None = None
        self._open = 0

    def track(self, items: Iterable[Item], description: str, total: int | None = None) -> Iterator[Item]:
        """Pass ``items`` through while the bar advances.

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
        if total is None and isinstance(items, Sized):
            total = len(items)
        yield from (
            self._bar(items, description, total)
            if self.console.is_terminal
            else self._lines(items, description, total)
        )

    def note(self, text: str) -> None:
        """Print one line.

        Parameters
        ----------
        text : str
            Line to print.
        """
        # As it is: square brackets are no markup, and ":x:" is no picture.
        self.console.print(f"{self.prefix}{text}", markup=False, emoji=False, highlight=False, soft_wrap=True)

    def _bar(self, items: Iterable[Item], description: str, total: int | None) -> Iterator[Item]:
        # One display holds the bars of all levels: a second display at once would overwrite the first.
        if self._display is None:
            self._display = Progress(*_columns(), console=self.console, transient=True)
            self._display.start()
        display, self._open = self._display, self._open + 1
        bar = display.add_task(description, total=total)
        try:
            for item in items:
                yield item
                display.advance(bar)
        finally:
            display.remove_task(bar)
            self._open -= 1
            if not self._open:
                display.stop()
                self._display = None

    def _lines(self, items: Iterable[Item], description: str, total: int | None) -> Iterator[Item]:
        started = last = time.monotonic()
        for done, item in enumerate(items):
            now = time.monotonic()
            if done and now - last >= LINE_EVERY_S:
                last = now
                left = f", about {(now - started) / done * (total - done):.0f} s left" if total else ""
                self.note(f"{description}: {done}{f' of {total}' if total else ''}{left}")
            yield item


def plain_console() -> Console:
    """Standard error as if it were no terminal: lines only, never a bar.

    Returns
    -------
    Console
        The console.
    """
    return Console(stderr=True, force_terminal=False)


def _columns() -> tuple[ProgressColumn, ...]:
    return (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )


def print_tables(tables: dict[str, pd.DataFrame], console: Console | None = None) -> None:
    """Print small result tables. Names of columns break at their underscores, so that the tables stay narrow.

    Parameters
    ----------
    tables : dict[str, pd.DataFrame]
        Tables by title.
    console : Console or None, optional
        Where to print; None for standard output.
    """
    console = console or Console(file=sys.stdout)
    # A table wider than the terminal had better wrap than lose digits.
    console.width = max(console.width, WIDEST_TABLE)
    for title, frame in tables.items():
        # As Text: in a plain string rich takes what stands in square brackets for markup and leaves it out.
        table = Table(title=Text(title, "table.title"), title_justify="left", box=box.SIMPLE_HEAD)
        rows = [[cell_text(value) for value in row] for row in frame.itertuples(index=False)]
        for index, column in enumerate(frame.columns):
            numeric = frame[column].dtype.kind in "if"
            width = max([len(row[index]) for row in rows] + [9])
            table.add_column(
                Text(_broken(str(column), width)),
                justify="right" if numeric else "left",
                no_wrap=True,
                overflow="ellipsis",
            )
        for row in rows:
            table.add_row(*map(Text, row))
        console.print(table)


def _broken(name: str, width: int) -> str:
    """The name of a column on as many lines of at most ``width`` as its parts between underscores allow."""
    lines = [""]
    for part in re.findall(r"[^_]+_?", name):
        if lines[-1] and len(lines[-1]) + len(part) > width:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)


def cell_text(value: object) -> str:
    """A table's cell: three significant decimals for a number, nothing for a missing one.

    Parameters
    ----------
    value : object
        Value of a table.

    Returns
    -------
    str
        The text.
    """
    if isinstance(value, float):
        return "" if value != value else f"{value:.3f}"
    return str(value)


def markdown(tables: dict[str, pd.DataFrame]) -> str:
    """The same tables as Markdown.

    Parameters
    ----------
    tables : dict[str, pd.DataFrame]
        Tables by title.

    Returns
    -------
    str
        The tables.
    """
    parts = []
    for title, frame in tables.items():
        rows = [[cell_text(value) for value in row] for row in frame.itertuples(index=False)]
        lines = [[_field(str(name)) for name in frame.columns], ["---"] * len(frame.columns)]
        lines += [[_field(value) for value in row] for row in rows]
        parts.append(f"### {title}\n\n" + "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n")
    return "\n".join(parts)


def _field(text: str) -> str:
    """Text as a field of a Markdown table, which a stroke or a line's end would break."""
    return " ".join(text.replace("|", "\\|").splitlines()) if text else text


def print_closing(findings: Iterable[str], folder: Path, dashboard: str | None) -> None:
    """The last lines: what was found, where the files are, how to open the dashboard.

    Parameters
    ----------
    findings : Iterable[str]
        Results as plain sentences.
    folder : Path
        Folder of the results.
    dashboard : str or None
        Command or address that opens the dashboard; None if nothing is tracked.
    """
    for finding in findings:
        print(finding)
    print(f"Files: {folder}")
    if dashboard is not None:
        print(f"Dashboard: {dashboard}")
