"""Frames that are lost: as many as asked for, one by one or in a run, and their points with them."""

from __future__ import annotations

import numpy as np
import pytest

from registration.errors import InputError
from registration.perturbation.frame_dropout import in_kept_frames, loss_of

# Twenty frames of three points each, numbered from 40 on, in mixed order.
FRAME = np.random.default_rng(0).permutation(np.repeat(np.arange(40, 60), 3))


@pytest.mark.parametrize("loss", ["scattered", "contiguous"])
def test_whole_frames_are_lost_as_many_as_asked_for(loss: str) -> None:
    for number in range(20):
        kept = in_kept_frames(FRAME, 0.3, loss, np.random.default_rng(number))
        lost = np.unique(FRAME[~kept])
        assert len(lost) == 6
        assert not np.isin(FRAME[kept], lost).any()
        if loss == "contiguous":
            assert np.ptp(lost) == 5


def test_runs_begin_anywhere_and_scattered_frames_are_everywhere() -> None:
    begins = {
        FRAME[~in_kept_frames(FRAME, 0.5, "contiguous", np.random.default_rng(n))].min() for n in range(200)
    }
    assert begins == set(range(40, 51))
    ever = {
        int(f)
        for n in range(60)
        for f in FRAME[~in_kept_frames(FRAME, 0.1, "scattered", np.random.default_rng(n))]
    }
    assert ever == set(range(40, 60))


def test_nothing_is_lost_of_nothing_and_something_is_always_left() -> None:
    assert in_kept_frames(FRAME, 0.0, "contiguous", np.random.default_rng(0)).all()
    assert in_kept_frames(np.array([3, 3, 3]), 0.9, "scattered", np.random.default_rng(0)).all()
    assert in_kept_frames(FRAME, 0.99, "scattered", np.random.default_rng(0)).sum() == 3


def test_losses_take_turns() -> None:
    assert [loss_of("alternating", trial) for trial in range(4)] == ["scattered", "contiguous"] * 2
    assert loss_of("contiguous", 0) == "contiguous"


@pytest.mark.parametrize(
    "share, loss, message",
    [
        (1.0, "scattered", "missing_share: expected below 1"),
        (-0.1, "scattered", "missing_share: expected a number of at least 0"),
        (0.2, "alternating", "loss: expected scattered or contiguous"),
    ],
)
def test_what_is_no_loss_is_refused(share: float, loss: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        in_kept_frames(FRAME, share, loss, np.random.default_rng(0))
    with pytest.raises(InputError, match="missing: expected one of"):
        loss_of("sometimes", 0)
