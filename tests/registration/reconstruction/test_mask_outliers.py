"""Masks that disagree with their neighbours are found; what a vessel does by itself is not taken for a fault."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from registration import transforms
from registration.errors import InputError
from registration.reconstruction.mask_outliers import MaskOutliers

PIXEL_MM, STEP_MM, SIZE_PX = 0.25, 0.75, 96


def sweep(
    count: int,
    radius_mm: Callable[[float], float],
    middle_mm: Callable[[float], tuple[float, float]] = lambda z: (0.0, 0.0),
    noise_mm: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Discs of known radius and place in frames along z, and the frames' transforms."""
    rng = np.random.default_rng(0)
    row, column = np.mgrid[:SIZE_PX, :SIZE_PX] - (SIZE_PX - 1) / 2
    masks, poses = [], []
    for index in range(count):
        x, y = middle_mm(STEP_MM * index)
        masks.append(
            PIXEL_MM * np.hypot(column - x / PIXEL_MM, row - y / PIXEL_MM) < radius_mm(STEP_MM * index)
        )
        pose = np.diag([PIXEL_MM, PIXEL_MM, PIXEL_MM, 1.0])
        pose[:2, 3] = -PIXEL_MM * (SIZE_PX - 1) / 2
        pose[2, 3] = STEP_MM * index
        poses.append(transforms.translation(rng.normal(0, noise_mm, 3)) @ pose)
    return np.stack(masks), np.stack(poses)


def branching(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A vessel that divides half way, its branches 36 degrees apart."""
    one = sweep(count, lambda z: 3.0, lambda z: (max(z - 15, 0) * 0.33, 0.0))
    other = sweep(count, lambda z: 2.2, lambda z: (-max(z - 15, 0) * 0.33, 0.0))
    return one[0] | other[0], one[1]


@pytest.mark.parametrize(
    "made",
    [
        sweep(40, lambda z: 3.0),
        sweep(40, lambda z: 3.0, noise_mm=0.3),
        # Oblique by 45 degrees; narrow by half within 3 mm; ending in a dome on both sides.
        sweep(24, lambda z: 3.0, lambda z: (z - 9, 0.0)),
        sweep(40, lambda z: 3.0 - 1.5 * np.exp(-(((z - 15) / 2) ** 2))),
        sweep(40, lambda z: np.sqrt(max(9 - max(abs(z - 15) - 10, 0) ** 2, 0))),
        # A second vessel comes into view at once.
        (
            lambda masks, poses: (
                np.concatenate([masks[:20], masks[20:] | np.roll(masks[20:], 30, axis=2)]),
                poses,
            )
        )(*sweep(40, lambda z: 3.0)),
        branching(40),
        # Frames missing.
        tuple(part[np.r_[0:12, 28:40]] for part in sweep(40, lambda z: 3.0, lambda z: (0.3 * z, 0.0))),
    ],
)
def test_what_a_vessel_does_by_itself_is_no_fault(made: tuple[np.ndarray, np.ndarray]) -> None:
    masks, poses = made
    found = MaskOutliers()(masks, poses)
    assert not found.rejected.any(), found.reason
    assert not found.specks.any()
    assert all(map(np.shares_memory, found.frames, masks))


def turned(mask: np.ndarray) -> np.ndarray:
    row, column = np.nonzero(mask)
    thin = np.zeros_like(mask)
    middle_row, middle_column = int(row.mean()), int(column.mean())
    thin[middle_row - 3 : middle_row + 4, middle_column - 32 : middle_column + 33] = True
    return thin


@pytest.mark.parametrize(
    "spoil, reason",
    [
        (lambda mask: np.roll(mask, 9, axis=1), "position"),
        (lambda mask: np.roll(mask, -30, axis=0), "position"),
        (lambda mask: np.ones_like(mask), "size"),
        (lambda mask: np.kron(mask, np.ones((2, 2), bool))[48:144, 48:144], "size"),
        (lambda mask: mask & (np.arange(SIZE_PX) % 4 == 0), "shape"),
        (turned, "shape"),
    ],
)
@pytest.mark.parametrize("frame", [0, 1, 17, 39])
def test_a_wrong_mask_is_found_anywhere_in_a_sweep(
    spoil: Callable[[np.ndarray], np.ndarray], reason: str, frame: int
) -> None:
    masks, poses = sweep(40, lambda z: 3.0, noise_mm=0.05)
    masks[frame] = spoil(masks[frame])
    found = MaskOutliers()(masks, poses)
    assert np.flatnonzero(found.rejected).tolist() == [frame]
    assert found.reason[frame] == reason
    assert found.excess[frame] > 1
    assert not found.frames[frame].any()
    assert masks[frame].any()
    # The others are not copied: a sweep's masks take hundreds of megabytes.
    assert [np.shares_memory(own, masks) for own in found.frames] == [at != frame for at in range(40)]
    np.testing.assert_array_equal(np.delete(found.frames, frame, 0), np.delete(masks, frame, 0))


def test_a_tenth_of_wrong_masks_in_a_branching_vessel_with_a_gap() -> None:
    masks, poses = branching(54)
    kept = np.r_[0:34, 42:54]
    masks, poses = masks[kept], poses[kept]
    wrong = [3, 14, 15, 27, 40]
    for place, frame in enumerate(wrong):
        masks[frame] = np.roll(masks[frame], (25, -25)[place % 2], axis=place % 3 % 2)
    found = MaskOutliers()(masks, poses)
    assert np.flatnonzero(found.rejected).tolist() == wrong


def test_probabilities_are_judged_where_they_show_the_vessel() -> None:
    masks, poses = sweep(30, lambda z: 3.0)
    masks[11] = np.roll(masks[11], 20, axis=0)
    values = np.where(masks, 0.8, 0.1).astype(np.float32)
    found = MaskOutliers()(values, poses)
    assert np.flatnonzero(found.rejected).tolist() == [11]
    assert (found.frames[11] == 0).all()
    assert found.frames[11].dtype == np.float32
    assert not MaskOutliers()(values, poses, level=0.9).rejected.any()


def test_a_speck_is_taken_out_and_a_branch_that_begins_is_not() -> None:
    masks, poses = sweep(30, lambda z: 3.0)
    masks[9, 4:10, 4:10] = True
    masks[20:, 4:10, 80:86] = True
    found = MaskOutliers()(masks, poses)
    assert np.flatnonzero(found.specks).tolist() == [9]
    assert not found.frames[9][:12, :12].any()
    assert masks[9, 4:10, 4:10].all()
    assert np.array(found.frames)[20:, 4:10, 80:86].all()


def test_empty_masks_between_others_are_marked_and_not_rejected() -> None:
    masks, poses = sweep(30, lambda z: 3.0)
    masks[[0, 1, 12, 13, 29]] = False
    found = MaskOutliers()(masks, poses)
    assert np.flatnonzero(found.empty).tolist() == [12, 13]
    assert not found.rejected.any()


def test_where_most_masks_disagree_none_is_rejected() -> None:
    masks, poses = sweep(40, lambda z: 2.0)
    rng = np.random.default_rng(1)
    for frame in rng.permutation(40)[:24]:
        masks[frame] = np.roll(masks[frame], tuple(rng.integers(-35, 36, 2)), axis=(0, 1))
    found = MaskOutliers(deviations=2.0)(masks, poses)
    assert found.undecided > 0.35
    assert not found.rejected.any()
    assert all(map(np.shares_memory, found.frames, masks))


def test_few_masks_and_settings() -> None:
    masks, poses = sweep(5, lambda z: 3.0)
    masks[2] = np.roll(masks[2], 30, axis=0)
    assert not MaskOutliers()(masks, poses).rejected.any()
    masks, poses = sweep(20, lambda z: 3.0)
    masks[2] = np.roll(masks[2], 30, axis=0)
    assert not MaskOutliers(enabled=False)(masks, poses).rejected.any()
    for wrong in ({"window": 2}, {"position": 0.0}, {"max_share": 1.5}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            MaskOutliers(**wrong)  # type: ignore[arg-type]
