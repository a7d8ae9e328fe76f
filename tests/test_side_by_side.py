"""make bench: ratios of sides that took turns, right and wrong results, and the page, with known answers."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import replace
from pathlib import Path

import benchmark_page
import benchmarks
import pandas as pd
import pytest
import side_by_side
from claims_framework import called
from claims_mended import earlier_tree
from pipeline_profile import StageClock, busiest
from side_by_side import (
    NO_DIFFERENCE,
    OURS_FASTER,
    PEER_FASTER,
    Claim,
    Measured,
    Side,
    Times,
    conclusion,
    correct,
    measure,
    ratio_of,
)


class Ticking:
    """Clocks that only move when a side works."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 0.0
        monkeypatch.setattr(side_by_side.time, "perf_counter", lambda: self.now_s)
        monkeypatch.setattr(side_by_side, "_cpu_s", lambda: self.now_s / 2)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Ticking:
    return Ticking(monkeypatch)


def claim(clock: Ticking, ours_s: list[float], peer_s: list[float], **named: object) -> Claim:
    """Sides that take these seconds in each round, the warm-up first, and return the round's number."""
    order: list[str] = []

    def side(name: str, seconds: list[float], **more: float) -> Side:
        def call(number: int) -> int:
            order.append(name)
            clock.now_s += seconds[number]
            return number

        return Side(name, call, **more)

    made = Claim(
        "claim",
        "work",
        side("ours", ours_s),
        lambda number, result: abs(number - result),
        "difference",
        0.0,
        [side("peer", peer_s)],
        rounds=len(ours_s) - 1,
    )
    object.__setattr__(made, "order", order)
    return replace(made, **named) if named else made


def times(seconds: list[float], errors: list[float] | None = None, name: str = "side") -> Times:
    return Times(name, "package 1", seconds, seconds, errors or [0.0] * len(seconds))


def measured(ours: Times, *peers: Times, limit: float = 0.5) -> Measured:
    return Measured("claim", "work", "error, mm", limit, [ours, *peers], ["Remark."], (0.5, 1.5))


def test_a_ratio_is_the_median_of_the_rounds_with_its_least_and_greatest(clock: Ticking) -> None:
    found = measure(claim(clock, [9, 1, 2, 4], [9, 2, 8, 12]))
    ratio = ratio_of(*found.sides)
    assert ratio is not None
    # By round 2, 4 and 3: pairs, not the ratio of the medians, which is 4.
    assert (ratio.low, ratio.median, ratio.high) == pytest.approx((2, 3, 4))
    assert ratio.by_cpu == pytest.approx(22 / 7)
    assert ratio.verdict == OURS_FASTER


def test_the_warm_up_is_not_counted_and_who_is_first_changes(clock: Ticking) -> None:
    asked = claim(clock, [50, 1, 1], [70, 1, 1])
    found = measure(asked)
    assert [each.seconds for each in found.sides] == [[1, 1], [1, 1]]
    assert asked.order == ["peer", "ours", "ours", "peer", "peer", "ours"]  # type: ignore[attr-defined]


def test_seconds_of_a_part_of_the_work_are_multiplied() -> None:
    part = Side("a tenth", lambda number: time.sleep(0.01) or number, scale=10.0)
    made = Claim("c", "w", part, lambda *_: 0.0, "e", 0.0, rounds=1, warm_up=False)
    assert 0.1 <= measure(made).sides[0].seconds[0] < 1.0


@pytest.mark.parametrize("rounds", [1, 2])
def test_fewer_than_three_rounds_give_no_ratio(rounds: int) -> None:
    ours, peer = times([1.0] * rounds), times([2.0] * rounds)
    assert ratio_of(ours, peer) is None
    assert "no ratio" in conclusion(measured(ours, peer), peer)
    assert "ratio" not in benchmark_page.rows_of([measured(ours, peer)])


@pytest.mark.parametrize(
    ("peer_s", "verdict"),
    [([2, 2, 2], OURS_FASTER), ([0.5, 0.4, 0.9], PEER_FASTER), ([0.5, 2, 2], NO_DIFFERENCE)],
)
def test_nobody_is_faster_unless_every_round_says_so(peer_s: list[float], verdict: str) -> None:
    ratio = ratio_of(times([1, 1, 1]), times(peer_s))
    assert ratio is not None
    assert ratio.verdict == verdict


def test_a_refusal_and_nan_are_wrong_results() -> None:
    def refuse(number: int) -> int:
        raise ValueError("number: expected another")

    made = Claim("c", "w", Side("ours", refuse), lambda *_: 0.0, "e", 0.0, rounds=2)
    found = measure(made).sides[0]
    assert found.errors == [math.inf, math.inf]
    assert correct(found, 1.0) == 0
    assert correct(times([1, 1], [math.nan, 0.2]), 0.5) == 1


def test_a_fast_side_with_wrong_results_is_called_wrong() -> None:
    ours, peer = times([1, 1, 1], [0.1, 0.1, 0.7]), times([0.1, 0.1, 0.1], [9.0, 9.0, 9.0])
    said = conclusion(measured(ours, peer), peer)
    assert said == f"{PEER_FASTER}; ours right in 2 of 3; the peer right in 0 of 3"


def test_what_was_measured_survives_a_file() -> None:
    import json

    found = measured(times([1, 2, 3]), times([2, 3, 4], [0.0, math.inf, 0.0]))
    assert Measured.of_plain(json.loads(json.dumps(found.as_plain()))) == found


def test_the_tables_have_a_row_for_each_peer_and_one_where_there_is_none() -> None:
    both = measured(times([1, 1, 2]), times([2, 3, 2], name="first"), times([1, 1, 1], name="second"))
    alone = measured(times([1.0, 2.0, 4.0]))
    rows = benchmark_page.rows_of([both, alone])
    assert rows["ratio"].tolist()[:2] == [2.0, 1.0]
    assert rows["ours_s"].tolist() == [1.0, 1.0, 2.0]
    assert pd.isna(rows["ratio"][2])
    assert pd.isna(rows["peer"][2])
    shown = benchmark_page.shown_table([both, alone])
    assert shown["ratio"].tolist() == ["**2.00** (1.00 to 3.00)", "**1.00** (0.50 to 1.00)", "-"]
    assert shown["shows"].tolist() == [NO_DIFFERENCE, NO_DIFFERENCE, "no peer"]


def test_the_page_says_where_the_peer_is_faster_and_what_is_missing() -> None:
    slow = measured(times([2, 2, 2]), times([1, 1, 1], [0, 0, 9], name="drift"))
    profile = {
        "stages": {"simulate": [3.0, 1.0, 2.0], "segment": [1.0, 1.0, 1.0]},
        "whole_s": [4.0, 4.0, 4.0],
        "functions": {"simulate": [{"function": "scan:beam", "calls": 7, "share": 0.25}]},
    }
    head = {"command": "c", "commit": "", "date": "d", "machine": "m", "name": "benchmarks"}
    text = benchmark_page.page_text([slow], profile, ["rigid: not measured, no wheel"], head)
    assert "The peer is faster in 1 of 1 rows: claim (drift: 0.50, right in 2 of 3)." in text
    assert "- rigid: not measured, no wheel" in text
    assert "Remark." in text
    assert "| simulate | 2.00 (1.00 to 3.00) | 50% |" in text
    assert "| scan:beam | 7 | 25% |" in text


def test_the_plot_has_a_line_for_each_ratio_and_is_hollow_where_the_peer_is_wrong() -> None:
    both = measured(
        times([1, 1, 1]), times([2, 4, 3], name="right"), times([0.5] * 3, [0, 0, 9], name="wrong")
    )
    axes = benchmark_page.ratio_figure([both, measured(times([1.0]))]).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        "claim: right (package)",
        "claim: wrong (package)",
    ]
    assert axes.get_xscale() == "log"
    spans = [line.get_xdata() for line in axes.lines if len(line.get_xdata()) == 2][:2]
    assert [list(span) for span in spans] == [[2, 4], [0.5, 0.5]]
    points = [line for line in axes.lines if len(line.get_xdata()) == 1]
    assert [line.get_xdata()[0] for line in points] == [3, 0.5]
    assert [line.get_markerfacecolor() for line in points] == ["#0072B2", "white"]


def test_every_claim_of_the_page_is_a_function() -> None:
    # Those of the segmentation import torch and MONAI when they are made, not here.
    assert all(callable(benchmarks.claim_of(name)) for name in benchmarks.CLAIMS)


def test_an_unknown_claim_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["benchmarks.py", "--only", "rigid,speed"])
    with pytest.raises(SystemExit) as ended:
        benchmarks.main()
    assert ended.value.code == 2
    assert "received speed" in capsys.readouterr().err


def test_a_claim_that_fails_is_a_sentence_on_the_page(tmp_path: Path) -> None:
    assert benchmarks.apart("nothing", True, tmp_path) == "nothing: not measured, KeyError: 'nothing'"


def test_resume_takes_what_was_measured_with_its_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def apart(name: str, quick: bool, work: Path) -> dict[str, int] | str:
        calls.append(name)
        return {"call": len(calls)} if name == "works" else "fails: not measured"

    monkeypatch.setattr(benchmarks, "apart", apart)

    def call_of(commit: str, resume: bool) -> tuple[int, str]:
        made = benchmarks.kept_or_measured("works", False, tmp_path, commit, resume)
        assert isinstance(made, dict)
        return made["found"]["call"], made["commit"]

    assert call_of("a", True) == (1, "a")
    assert call_of("b", True) == (1, "a")
    assert call_of("b", False) == (2, "b")
    # What could not be measured is tried again.
    for _ in range(2):
        assert benchmarks.kept_or_measured("fails", False, tmp_path, "b", True) == "fails: not measured"
    assert calls == ["works", "works", "fails", "fails"]


@pytest.mark.parametrize(
    ("code", "expected", "lacking"),
    [("print('a b')", ["a", "b"], 0), ("print('a')", ["a", "b"], 1), ("raise SystemExit(3)", [], 3)],
)
def test_a_program_is_wrong_by_its_exit_code_or_by_words_that_it_does_not_print(
    code: str, expected: list[str], lacking: int
) -> None:
    assert called([sys.executable, "-c", code], expected) == lacking


def test_a_commit_that_git_does_not_have_is_no_peer() -> None:
    assert earlier_tree("0000000000000000000000000000000000000001") is None


def test_a_stage_has_the_seconds_of_its_outermost_function_and_its_profile() -> None:
    class Stage:
        def whole(self) -> int:
            time.sleep(0.02)
            return self.part() + 1

        def part(self) -> int:
            time.sleep(0.02)
            return 1

        @classmethod
        def made(cls) -> Stage:
            return cls()

    clock = StageClock(("outer",))
    clock.watch("outer", Stage, "whole")
    clock.watch("inner", Stage, "part")
    clock.watch("made", Stage, "made")
    assert Stage.made().whole() == 2
    assert set(clock.seconds) == {"outer", "made"}
    assert clock.seconds["outer"] >= 0.04
    functions = busiest(clock.profiles["outer"], 1)
    assert "sleep" in functions[0]["function"]
    assert functions[0]["calls"] == 2
    assert functions[0]["share"] > 0.9
