"""A PLUS sequence with tracked probe and reference, whose poses are known."""

from __future__ import annotations

import numpy as np
from sweeps import CALIBRATION, world_T_ee

from registration.readers.plus.sequence import PlusSequence

TIMES_S = np.array([1.0, 1.1, 1.2, 1.3])


def text(matrix: np.ndarray) -> str:
    return " ".join(repr(float(number)) for number in matrix.reshape(-1))


def tracked_sequence(
    statuses: tuple[str, ...] = ("OK", "OK", "OK", "OK"), **every_frame: str
) -> PlusSequence:
    """Four frames whose Probe and Reference are tracked; Reference stands obliquely in the tracker's frame."""
    tracker_T_reference = world_T_ee(np.array([7.0]))[0]
    pixels = np.random.default_rng(1).integers(0, 256, (4, 3, 5)).astype(np.uint8)
    fields = tuple(
        {
            "ProbeToTrackerTransform": text(tracker_T_reference @ pose),
            "ProbeToTrackerTransformStatus": status,
            "ReferenceToTrackerTransform": text(tracker_T_reference),
            "ReferenceToTrackerTransformStatus": "OK",
            "ImageToProbeTransform": text(CALIBRATION.probe_A_pixel),
            "Timestamp": repr(float(time_s)),
            "UnfilteredTimestamp": repr(float(time_s) + 0.004),
            "ImageStatus": "OK",
            **every_frame,
        }
        for time_s, pose, status in zip(TIMES_S, world_T_ee(TIMES_S), statuses, strict=True)
    )
    return PlusSequence(pixels, fields)
