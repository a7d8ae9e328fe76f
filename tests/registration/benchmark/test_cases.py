"""The digest of a case: it changes with the numbers, and not with their rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from benchmark_cases import drawn_case

from registration.benchmark.cases import digest

CASE, TRUTH = drawn_case()


def test_the_digest_is_the_same_for_the_same_numbers() -> None:
    assert digest(CASE, TRUTH) == digest(*drawn_case())
    assert len(digest(CASE, TRUTH)) == 16
    int(digest(CASE, TRUTH), 16)


def test_rounding_does_not_change_it() -> None:
    steady = replace(CASE, moving_mm=np.round(CASE.moving_mm, 4))
    shaken = replace(steady, moving_mm=steady.moving_mm + 1e-9)
    assert digest(steady, TRUTH) == digest(shaken, TRUTH)


def test_any_other_change_does() -> None:
    known = digest(CASE, TRUTH)
    moved, pose, covered = CASE.moving_mm.copy(), TRUTH.fixed_T_moving.copy(), TRUTH.covered.copy()
    moved[17, 2] += 1e-3
    pose[0, 3] += 1e-3
    covered[0] = not covered[0]
    frame = CASE.moving_frame.copy()
    frame[3] += 1
    for changed in (
        (replace(CASE, moving_mm=moved), TRUTH),
        (replace(CASE, moving_frame=frame), TRUTH),
        (replace(CASE, fixed_mm=CASE.fixed_mm[::-1].copy()), TRUTH),
        (CASE, replace(TRUTH, fixed_T_moving=pose)),
        (CASE, replace(TRUTH, covered=covered)),
        (CASE, replace(TRUTH, outlier=~TRUTH.outlier)),
    ):
        assert digest(*changed) != known


def test_what_a_case_has_besides_counts_and_what_it_lacks_does_not() -> None:
    known = digest(CASE, TRUTH)
    line_mm, moved_mm = np.zeros((4, 3)), np.zeros((len(TRUTH.targets_mm), 3))
    other = replace(TRUTH, same_vessel=False, fixed_T_moving=np.full((4, 4), np.nan))
    found = {
        known,
        digest(replace(CASE, moving_centerline_mm=line_mm), TRUTH),
        digest(replace(CASE, initial=np.eye(4)), TRUTH),
        digest(CASE, replace(TRUTH, displacement_mm=moved_mm)),
        digest(CASE, replace(TRUTH, displacement_mm=moved_mm + 1)),
        digest(CASE, other),
    }
    assert len(found) == 6
    assert digest(CASE, replace(TRUTH, block="noise")) == known
