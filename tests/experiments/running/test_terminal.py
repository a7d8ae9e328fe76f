"""What the terminal shows."""

from __future__ import annotations

import io
import re

import pandas as pd
import pytest
from rich.console import Console

from experiments.running.terminal import (
    WIDEST_LINE,
    TerminalProgress,
    cell_text,
    markdown,
    print_closing,
    print_tables,
)
from experiments.running.verbosity import VARIABLE

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


def test_two_columns_of_one_name_stand_side_by_side() -> None:
    shown = io.StringIO()
    frame = pd.DataFrame([["a", 1.5]], columns=["same", "same"])
    print_tables({"t": frame}, Console(file=shown, width=80))
    assert shown.getvalue().count("same") == 2 and "1.500" in shown.getvalue()


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


WIDE = pd.DataFrame({f"measure_number_{number}_mm": [float(number)] for number in range(20)})


@pytest.mark.parametrize("width", [40, 80, 100, 220])
def test_on_a_terminal_a_table_has_the_columns_that_fit_and_names_the_others(width: int) -> None:
    stream = io.StringIO()
    print_tables({"Wide": WIDE}, Console(file=stream, force_terminal=True, width=width, color_system=None))
    lines = stream.getvalue().splitlines()
    assert max(map(len, lines)) <= min(width, WIDEST_LINE)
    assert "0.000" in stream.getvalue() and "19.000" not in stream.getvalue()
    (more,) = [line for line in lines if " more in summary.md" in line]
    shown = stream.getvalue().split(more)[0].count(".000")
    assert more.startswith(f"{20 - shown} more")


TEXTS = pd.DataFrame(
    {
        "measured_on": ["artery, 100 %, cpd, " + "a long condition " * 3],
        "command": ["ctus study=accuracy " * 4],
        "tre_mm_over_everything": [12345678.5],
    }
)


@pytest.mark.parametrize("width", [80, 100])
def test_on_a_terminal_long_texts_are_shortened_before_a_column_is_left_out(width: int) -> None:
    stream = io.StringIO()
    print_tables({"Long": TEXTS}, Console(file=stream, force_terminal=True, width=width, color_system=None))
    assert "12345678.500" in stream.getvalue() and "more in summary.md" not in stream.getvalue()
    assert "artery, 100 %, cpd" in stream.getvalue() and "…" in stream.getvalue()
    assert max(map(len, stream.getvalue().splitlines())) <= width
    assert TEXTS["command"][0] in markdown({"Long": TEXTS})


def test_a_text_that_fits_is_not_shortened() -> None:
    stream = io.StringIO()
    one = TEXTS[["measured_on"]]
    print_tables({"Long": one}, Console(file=stream, force_terminal=True, width=100, color_system=None))
    assert one["measured_on"][0].strip() in stream.getvalue()


def test_a_pipe_and_verbose_get_every_column(monkeypatch) -> None:
    for terminal, level in ((False, "normal"), (True, "verbose")):
        monkeypatch.setenv(VARIABLE, level)
        stream = io.StringIO()
        print_tables({"Wide": WIDE.iloc[:, :12]}, Console(file=stream, force_terminal=terminal, width=80))
        assert "11.000" in stream.getvalue() and "more in summary.md" not in stream.getvalue()


def test_a_pipe_gets_every_cell_of_a_table_of_long_texts() -> None:
    many = pd.DataFrame(
        {f"text_{n}": [f"cell {n} " + "of a long text " * 5] for n in range(14)} | {"last": ["end"]}
    )
    for frame in (TEXTS, many):
        stream = io.StringIO()
        print_tables({"Long": frame}, Console(file=stream, width=80))
        printed = stream.getvalue()
        assert all(str(value).strip() in printed for value in frame.iloc[0])
        assert len(printed.splitlines()) <= 8  # no line is wrapped


def test_a_pipe_gets_no_colours_and_whole_sentences(capsys, tmp_path) -> None:
    sentence = "A finding " + "of many words " * 20
    print_tables({"Folds": TABLE})
    print_closing([sentence], tmp_path, "mlflow ui")
    printed = capsys.readouterr().out
    assert "\x1b[" not in printed
    assert sentence in printed.splitlines()
    assert printed.endswith(f"Files: {tmp_path}\nDashboard: mlflow ui\n")


def test_on_a_terminal_a_long_sentence_is_wrapped(capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "160")
    print_closing(["A finding " + "of many words " * 20], tmp_path, None)
    lines = capsys.readouterr().out.splitlines()[:-1]
    assert len(lines) > 2 and max(map(len, lines)) <= WIDEST_LINE


def test_quiet_shows_no_bar_no_note_and_no_table(capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, "quiet")
    stream = io.StringIO()
    progress = TerminalProgress(Console(file=stream, force_terminal=True))
    assert list(progress.track([1, 2], "bar")) == [1, 2]
    progress.note("a note")
    print_tables({"Folds": TABLE}, Console(file=stream))
    print_closing(["a finding"], tmp_path, "mlflow ui")
    assert stream.getvalue() == ""
    assert capsys.readouterr().out == f"Files: {tmp_path}\n"


def test_verbose_says_when(monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, "verbose")
    stream = io.StringIO()
    TerminalProgress(Console(file=stream), prefix="fold=0: ").note("reading")
    assert re.fullmatch(r" *\d+\.\d s  fold=0: reading\n", stream.getvalue())
