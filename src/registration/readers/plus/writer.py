"""Tracked sweeps to sequence files of PLUS, with the calibration in every frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from registration import transforms
from registration.readers.plus.fields import TRANSFORM, write_sequence
from registration.readers.plus.reader import PlusReader
from registration.readers.plus.sequence import PlusSequence
from registration.sweep import TrackedSweep
from registration.synchronisation import synchronise


def write_plus(
    path: Path,
    sweep: TrackedSweep,
    max_gap_s: float,
    compressed: bool = True,
    reader: PlusReader | None = None,
) -> dict[str, int]:
    """Write a sweep as one sequence file in which each frame carries its pose.

    A sequence file has one transform a frame, so poses are brought to the frames' times first (see
    ``synchronise``). A sweep without images becomes a file of the tracker alone. The calibration goes into
    every frame as ``ImageToProbeTransform``.

    Parameters
    ----------
    path : Path
        MetaImage or NRRD sequence file.
    sweep : TrackedSweep
        Sweep.
    max_gap_s : float
        Longest time in s between two poses in which frames still get a pose.
    compressed : bool, optional
        Whether pixels are compressed.
    reader : PlusReader, optional
        Names of the coordinate frames, so that a reader with those names needs no device set; None takes the
        defaults.

    Returns
    -------
    dict of str to int
        Frames left out because they have no pose, counted by reason.
    """
    names = reader or PlusReader()
    pose_key, image_key = f"{names.ee}To{names.world}{TRANSFORM}", f"{names.image}To{names.ee}{TRANSFORM}"
    ee_A_pixel = sweep.calibration.ee_A_pixel
    if len(sweep.images):
        posed = synchronise(sweep, max_gap_s)
        times_s, pixels, dropped = sweep.image_times_s[posed.kept], sweep.images[posed.kept], posed.dropped
        poses = posed.world_A_pixel @ transforms.invert_affine(sweep.ee_A_pixel[posed.kept], "ee_A_pixel")
        images = sweep.ee_A_pixel[posed.kept]
    else:
        times_s, poses, dropped = sweep.pose_times_s, sweep.world_T_ee, dict(sweep.dropped)
        pixels = np.zeros((len(times_s), 0, 0), np.uint8)
        images = np.broadcast_to(ee_A_pixel, (len(times_s), 4, 4))
    fields = tuple(
        {
            pose_key: _text(pose),
            f"{pose_key}Status": "OK",
            image_key: _text(image),
            f"{image_key}Status": "OK",
            "Timestamp": repr(float(time_s)),
            "UnfilteredTimestamp": repr(float(time_s)),
            "ImageStatus": "OK" if len(sweep.images) else "INVALID",
        }
        for time_s, pose, image in zip(times_s, transforms.nearest_rigid(poses), images, strict=True)
    )
    write_sequence(path, PlusSequence(pixels, fields), compressed)
    return dropped


def _text(matrix: np.ndarray) -> str:
    return " ".join(repr(float(number)) for number in np.asarray(matrix).reshape(-1))
