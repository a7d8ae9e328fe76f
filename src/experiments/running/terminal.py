"""What the terminal shows: bars with the time left while work goes on, then what was found and where it lies."""

from __future__ import annotations

import re
import sys
import textwrap
import time
from collections.abc import Iterable, Iterator, Sized
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rich import box
from rich.console import Console
from rich.measure import Measurement
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

from experiments.running.verbosity import Verbosity, verbosity

if TYPE_CHECKING:
    import pandas as pd

Item = TypeVar("Item")
# Without a terminal (a log file, CI) a bar can't be redrawn; a line now and then says the same.
LINE_EVERY_S = 15.0
WIDEST_TABLE = 160
# Of a terminal so many columns are used, however wide it is: lines stay easy to read, and to show to others.
WIDEST_LINE = 100
# What a text in a cell is shortened to, one after the other, before columns are left out of a table on a terminal.
SHORTER_TEXTS = (80, 64, 48, 40, 32, 28, 24, 20, 17, 14)


class TerminalProgress:
    """Progress as a bar on a terminal, as a line now and then elsewhere; ``prefix`` comes before every line."""

    def __init__(self, console: Console | None = None, prefix: str = "") -> None:
        self.console = console or Console(stderr=True)
        self.prefix = prefix
        self._display: Progress | None = None
        self._open = 0
        self._started = time.monotonic()

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
        if verbosity() is Verbosity.QUIET:
            yield from items
            return
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
        level = verbosity()
        if level is Verbosity.QUIET:
            return
        passed = f"{time.monotonic() - self._started:7.1f} s  " if level is Verbosity.VERBOSE else ""
        # As it is: square brackets are no markup, and ":x:" is no picture.
        self.console.print(
            f"{passed}{self.prefix}{text}", markup=False, emoji=False, highlight=False, soft_wrap=True
        )

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

    On a terminal long texts in cells are shortened where a table would be too wide, and it has the columns that fit,
    from the left, and a line that names the others; ``verbose=true`` and a pipe get all of it, ``quiet=true`` nothing.

    Parameters
    ----------
    tables : dict[str, pd.DataFrame]
        Tables by title.
    console : Console or None, optional
        Where to print; None for standard output.
    """
    level = verbosity()
    if level is Verbosity.QUIET:
        return
    console = console or Console(file=sys.stdout)
    fitting = console.is_terminal and level is not Verbosity.VERBOSE
    # Elsewhere a table wider than the terminal had better wrap than lose digits.
    console.width = line_width(console) if fitting else max(console.width, WIDEST_TABLE)
    for title, frame in tables.items():
        count, longest = len(frame.columns), None
        if fitting:
            count, longest = _columns_that_fit(title, frame, console)
        else:
            console.width = max(console.width, _width(_table(title, frame, longest), console))
        console.print(_table(title, frame.iloc[:, :count], longest))
        if left := [str(name) for name in frame.columns[count:]]:
            more = f"{len(left)} more in summary.md: {', '.join(left)}"
            print(
                textwrap.shorten(more, console.width - 2, placeholder=" ..."), end="\n\n", file=console.file
            )


def line_width(console: Console) -> int:
    """The columns of a terminal that are used.

    Parameters
    ----------
    console : Console
        The terminal.

    Returns
    -------
    int
        Its width, at most ``WIDEST_LINE``.
    """
    return min(console.width, WIDEST_LINE)


def _columns_that_fit(title: str, frame: pd.DataFrame, console: Console) -> tuple[int, int | None]:
    """How many columns, from the left, the terminal is wide enough for, one at least, and how long a text may be."""

    def fits(count: int, longest: int | None) -> bool:
        return _width(_table(title, frame.iloc[:, :count], longest), console) <= console.width

    for longest in (None, *SHORTER_TEXTS):
        if fits(len(frame.columns), longest):
            return len(frame.columns), longest
    shortest = SHORTER_TEXTS[-1]
    return next(
        (count for count in range(len(frame.columns) - 1, 1, -1) if fits(count, shortest)), 1
    ), shortest


def _width(table: Table, console: Console) -> int:
    return Measurement.get(console, console.options.update_width(10_000), table).maximum


def _table(title: str, frame: pd.DataFrame, longest: int | None) -> Table:
    # As Text: in a plain string rich takes what stands in square brackets for markup and leaves it out.
    table = Table(title=Text(title, "table.title"), title_justify="left", box=box.SIMPLE_HEAD)
    rows = [[_shortened(value, longest) for value in row] for row in frame.itertuples(index=False)]
    for index, column in enumerate(frame.columns):
        numeric = frame.dtypes.iloc[index].kind in "if"
        width = max([len(row[index]) for row in rows] + [9])
        table.add_column(
            Text(_broken(str(column), width)),
            justify="right" if numeric else "left",
            no_wrap=True,
            overflow="ellipsis",
        )
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def _shortened(value: object, longest: int | None) -> str:
    """A cell's text, cut if it is longer; of numbers nothing is cut."""
    text = cell_text(value)
    cut = longest is not None and isinstance(value, str) and len(text) > longest
    return f"{text[: longest - 1].rstrip()}…" if cut and longest else text


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
    level = verbosity()
    if level is not Verbosity.QUIET:
        console = Console(file=sys.stdout)
        for finding in findings:
            # A pipe gets a sentence a line, so that what reads it finds whole ones.
            print(_wrapped(finding, line_width(console)) if console.is_terminal else finding)
    print(f"Files: {folder}")
    if dashboard is not None and level is not Verbosity.QUIET:
        print(f"Dashboard: {dashboard}")


def _wrapped(sentence: str, width: int) -> str:
    return textwrap.fill(
        sentence, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
