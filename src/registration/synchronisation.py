"""Bring the poses of a sweep to the times of its frames."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64

from registration import transforms
from registration.errors import InputError
from registration.sweep import PosedFrames, TrackedSweep

BEFORE_FIRST_POSE = "before the first pose"
AFTER_LAST_POSE = "after the last pose"
IN_A_GAP = "in a gap between poses longer than max_gap_s"


def synchronise(sweep: TrackedSweep, max_gap_s: float, offset_s: float = 0.0) -> PosedFrames:
    """Give every frame the pose at its time: SLERP for rotation, linear for translation between two poses.

    A frame outside the poses, or in a gap between them, is dropped and counted by reason; nothing is
    extrapolated. A frame at the very time of a pose takes that pose, whatever the gaps next to it. A
    recording without frames gives none.

    Parameters
    ----------
    sweep : TrackedSweep
        Frames and poses as recorded, at least two poses.
    max_gap_s : float
        Longest time in s between two poses in which frames still get a pose.
    offset_s : float, optional
        Added to the poses' times to bring them to the frames' clock, in s: a tracker that lags by 0.1 s
        stamps its poses 0.1 s late, so its offset is -0.1.

    Returns
    -------
    PosedFrames
        Frames with their poses; the counts of ``sweep.dropped`` are carried over.

    Raises
    ------
    InputError
        If a setting is out of range, there are fewer than two poses, or frames and poses do not overlap in
        time.
    """
    if not max_gap_s > 0:
        raise InputError(f"max_gap_s: expected a positive number of seconds, received {max_gap_s!r}")
    if not np.isfinite(offset_s):
        raise InputError(f"offset_s: expected a finite number of seconds, received {offset_s!r}")
    if len(sweep.world_T_ee) < 2:
        raise InputError(f"world_T_ee: expected at least two valid poses, received {len(sweep.world_T_ee)}")
    reasons = drop_reasons(sweep, max_gap_s, offset_s)
    keep = reasons == ""
    world_T_ee = transforms.interpolate(
        sweep.image_times_s[keep], sweep.pose_times_s + offset_s, sweep.world_T_ee
    )
    return PosedFrames(
        kept=np.flatnonzero(keep).astype(np.int64),
        world_A_pixel=world_T_ee @ sweep.ee_A_pixel[keep],
        dropped=_add_counts(dict(sweep.dropped), reasons[~keep]),
    )


def drop_reasons(sweep: TrackedSweep, max_gap_s: float, offset_s: float = 0.0) -> np.ndarray:
    """Find out why frames of a sweep have no pose.

    Parameters
    ----------
    sweep : TrackedSweep
        Frames and poses as recorded.
    max_gap_s : float
        Longest time in s between two poses in which frames still get a pose.
    offset_s : float, optional
        Added to the poses' times, in s.

    Returns
    -------
    ndarray of str, shape (n,)
        Reason for each frame, empty for a frame that has a pose.

    Raises
    ------
    InputError
        If frames and poses do not overlap in time.
    """
    times_s, pose_times_s = sweep.image_times_s, sweep.pose_times_s + offset_s
    if not len(times_s):
        return np.zeros(0, dtype="U64")
    before, after = times_s < pose_times_s[0], times_s > pose_times_s[-1]
    if times_s.max() < pose_times_s[0] or times_s.min() > pose_times_s[-1]:
        raise InputError(
            "sweep: expected frames and poses that overlap in time, "
            f"received frames from {times_s.min():.6g} to {times_s.max():.6g} s "
            f"and poses from {pose_times_s[0]:.6g} to {pose_times_s[-1]:.6g} s"
        )
    in_gap = ~before & ~after & _in_gap(times_s, pose_times_s, max_gap_s)
    return np.select([before, after, in_gap], [BEFORE_FIRST_POSE, AFTER_LAST_POSE, IN_A_GAP], "").astype(
        "U64"
    )


def _in_gap(
    times_s: Float64[np.ndarray, " n"], pose_times_s: Float64[np.ndarray, " m"], max_gap_s: float
) -> Bool[np.ndarray, " n"]:
    """Whether the poses on either side of each time are too far apart; never at the time of a pose."""
    following = np.clip(np.searchsorted(pose_times_s, times_s), 1, len(pose_times_s) - 1)
    at_a_pose = (times_s == pose_times_s[following]) | (times_s == pose_times_s[following - 1])
    return ~at_a_pose & (pose_times_s[following] - pose_times_s[following - 1] > max_gap_s)


def _add_counts(counted: dict[str, int], reasons: np.ndarray) -> dict[str, int]:
    for reason, count in zip(*np.unique(reasons, return_counts=True), strict=True):
        counted[str(reason)] = counted.get(str(reason), 0) + int(count)
    return counted
