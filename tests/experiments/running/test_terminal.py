"""What the terminal shows."""

from __future__ import annotations

import io

import pandas as pd
import pytest
from rich.console import Console

from experiments.running.terminal import TerminalProgress, cell_text, markdown, print_tables

TABLE = pd.DataFrame({"model": ["unet"], "dsc": [0.91234], "hd95_mm": [float("nan")]})


def test_progress_passes_every_item_through_on_a_terminal_and_in_a_log() -> None:
    for terminal in (True, False):
        stream = io.StringIO()
        progress = TerminalProgress(Console(file=stream, force_terminal=terminal, width=100))
        pairs = [
            (a, b)
            for a in progress.track([1, 2], "outer")
            for b in progress.track(iter("xy"), "inner", total=2)
        ]
        assert pairs == [(1, "x"), (1, "y"), (2, "x"), (2, "y")]


def test_a_loop_left_early_closes_its_bar() -> None:
    progress = TerminalProgress(Console(file=io.StringIO(), force_terminal=True))
    for item in progress.track(range(5), "first"):
        if item == 2:
            break
    assert list(progress.track(range(2), "second")) == [0, 1]


def test_a_number_has_three_decimals_and_a_missing_one_is_empty() -> None:
    assert cell_text(0.91234) == "0.912"
    assert cell_text(float("nan")) == ""
    assert cell_text(float("inf")) == "inf"
    assert cell_text(12) == "12"


def test_markdown_and_the_printed_table_hold_the_same_cells() -> None:
    assert "| unet | 0.912 |  |" in markdown({"Folds": TABLE})
    stream = io.StringIO()
    print_tables({"Folds": TABLE}, Console(file=stream, width=100))
    assert "0.912" in stream.getvalue()
    assert "Folds" in stream.getvalue()


ODD = "a [red]b[/red] [x] :x: $c$"


def test_names_stand_as_they_are() -> None:
    stream = io.StringIO()
    frame = pd.DataFrame({"model [of]": [ODD, "p|q"], "dsc": [1.0, 2.0]})
    print_tables({"Folds [/bold] [all]": frame}, Console(file=stream, width=120))
    printed = stream.getvalue()
    assert ODD in printed and "model [of]" in printed and "Folds [/bold] [all]" in printed
    assert "| p\\|q | 2.000 |" in markdown({"Folds": frame})


@pytest.mark.parametrize("terminal", [True, False])
def test_names_in_a_bar_and_a_note_stand_as_they_are(terminal: bool) -> None:
    stream = io.StringIO()
    progress = TerminalProgress(Console(file=stream, force_terminal=terminal, width=120, color_system=None))
    assert list(progress.track([1], f"{ODD} [/b]")) == [1]
    progress.note(f"reading {ODD} [/b]")
    assert f"reading {ODD} [/b]" in stream.getvalue()
    if terminal:
        assert f"{ODD} [/b]" in stream.getvalue().split("reading")[0]
