"""Which frames a case uses: counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from registration.benchmark.scenarios import KINDS, Kind, kind_named
from registration.errors import InputError

RNG = np.random.default_rng


@pytest.mark.parametrize(
    "place, first, last", [("start", 0, 59), ("middle", 20, 79), ("end", 40, 99)], ids=str
)
def test_a_piece_is_a_run_of_frames_at_its_place(place: str, first: int, last: int) -> None:
    found, kept = Kind("piece", 0.6, (place,)).choose(100, RNG(0))
    assert found == place
    assert kept.tolist() == list(range(first, last + 1))


def test_the_place_is_drawn_from_those_named() -> None:
    kind = Kind("piece", 0.4, ("start", "end"))
    places = {kind.choose(50, RNG(seed))[0] for seed in range(20)}
    assert places == {"start", "end"}


def test_frames_go_missing_in_two_gaps_and_one_by_one() -> None:
    for seed in range(20):
        _, kept = kind_named("missing").choose(200, RNG(seed))
        assert len(kept) == 140
        lost = np.setdiff1d(np.arange(200), kept)
        runs = np.split(lost, np.flatnonzero(np.diff(lost) > 1) + 1)
        # Gaps of 15 frames each, one in each half; scattered frames may lengthen them.
        assert sum(len(run) >= 15 for run in runs) >= 1
        assert sum((lost < 100) & (lost >= 0)) >= 15
        assert sum(lost >= 100) >= 15
        assert sum(len(run) <= 3 for run in runs) >= 5


def test_the_whole_sweep_keeps_every_frame() -> None:
    for name in ("whole", "outliers"):
        assert kind_named(name).choose(200, RNG(1))[1].tolist() == list(range(200))


def test_the_kinds_of_the_benchmark_cover_what_is_asked_of_it() -> None:
    assert sorted({kind.share for kind in KINDS}) == [0.4, 0.6, 0.8, 1.0]
    assert max(kind.outlier_share for kind in KINDS) == 0.1
    assert max(kind.missing_share for kind in KINDS) == 0.3
    assert len({kind.name for kind in KINDS}) == len(KINDS) == 8


def test_bad_kinds_are_refused() -> None:
    with pytest.raises(InputError, match="share: expected a number above 0 and at most 1"):
        Kind("none", 0.0)
    with pytest.raises(InputError, match="places: expected some of start, middle, end"):
        Kind("nowhere", places=("left",))
    with pytest.raises(InputError, match=r"missing_share, outlier_share: expected at most 0\.9"):
        Kind("gone", missing_share=0.95)
    with pytest.raises(InputError, match="kind: expected one of whole, piece80"):
        kind_named("piece10")
