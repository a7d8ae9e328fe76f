"""A robot-tracked ultrasound sweep: frames, poses with times of their own, and the probe's calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64, Int64, UInt8

from registration import transforms
from registration.brief import brief_repr
from registration.errors import InputError

# How the reasons begin for which a reader leaves out poses; the other reasons are of frames.
POSE_DROPPED = "pose: "


@dataclass(frozen=True)
class ProbeCalibration:
    """Where the image lies on the end effector.

    Parameters
    ----------
    ee_T_probe : ndarray, shape (4, 4)
        Rigid transform from the probe's coordinate frame to the end effector's, in mm.
    probe_A_pixel : ndarray, shape (4, 4)
        Affine transform from a pixel ``(column, row, 0, 1)`` (pixel centres, orientation MF) to mm in the
        probe's coordinate frame.

    Raises
    ------
    InputError
        If the first is not rigid or the second not affine.
    """

    ee_T_probe: Float64[np.ndarray, "4 4"]
    probe_A_pixel: Float64[np.ndarray, "4 4"]

    def __post_init__(self) -> None:
        transforms.require_rigid(self.ee_T_probe, "ee_T_probe")
        transforms.require_affine(self.probe_A_pixel, "probe_A_pixel")

    @property
    def ee_A_pixel(self) -> Float64[np.ndarray, "4 4"]:
        """From pixel ``(column, row, 0, 1)`` to millimetres on the end effector."""
        return transforms.compose(self.ee_T_probe, self.probe_A_pixel)

    @property
    def spacing_mm(self) -> tuple[float, float]:
        """Pixel size along rows and along columns, (vertical, horizontal), in mm."""
        column_step, row_step = np.linalg.norm(self.probe_A_pixel[:3, :2], axis=0)
        return float(row_step), float(column_step)


@dataclass(frozen=True)
class TrackedSweep:
    """Frames and poses as recorded, each with its own clock readings.

    Parameters
    ----------
    images : ndarray, shape (n, height, width)
        Frames in grey of 8 bits; none for a recording of the tracker alone.
    image_times_s : ndarray, shape (n,)
        Time of each frame.
    world_T_ee : ndarray, shape (m, 4, 4)
        Rigid poses of the end effector in the world, in mm.
    pose_times_s : ndarray, shape (m,)
        Time of each pose, strictly increasing.
    calibration : ProbeCalibration
        Where the image lies on the end effector.
    dropped : mapping of str to int, optional
        Recorded frames that the reader left out, counted by reason, and, under reasons that begin with
        ``pose:``, the poses.
    notes : tuple of str, optional
        Sentences for the user about what contradicts itself in the recording.
    image_A_pixel : ndarray, shape (n, 4, 4), optional
        Where the calibration is not the same for all frames (cropped elsewhere, another depth), the map from
        each frame's pixels to those that ``calibration`` speaks of; None where it is the same.

    Raises
    ------
    InputError
        If there are not as many times as frames or poses, a time is not finite, poses are out of order, or a
        matrix is not rigid or affine.
    """

    images: UInt8[np.ndarray, "n height width"]
    image_times_s: Float64[np.ndarray, " n"]
    world_T_ee: Float64[np.ndarray, "m 4 4"]
    pose_times_s: Float64[np.ndarray, " m"]
    calibration: ProbeCalibration
    dropped: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    image_A_pixel: Float64[np.ndarray, "n 4 4"] | None = None

    def __post_init__(self) -> None:
        if self.image_A_pixel is not None:
            transforms.require_affine(self.image_A_pixel, "image_A_pixel")
            if len(self.image_A_pixel) != len(self.images):
                raise InputError(
                    f"image_A_pixel: expected one matrix for each of {len(self.images)} images, "
                    f"received {len(self.image_A_pixel)}"
                )
        if len(self.images) != len(self.image_times_s):
            raise InputError(
                f"image_times_s: expected one time for each of {len(self.images)} images, "
                f"received {len(self.image_times_s)}"
            )
        if len(self.world_T_ee) != len(self.pose_times_s):
            raise InputError(
                f"pose_times_s: expected one time for each of {len(self.world_T_ee)} poses, "
                f"received {len(self.pose_times_s)}"
            )
        for name, times_s in (("image_times_s", self.image_times_s), ("pose_times_s", self.pose_times_s)):
            if not np.isfinite(times_s).all():
                raise InputError(f"{name}: expected finite times, received NaN or infinity")
        if (np.diff(self.pose_times_s) <= 0).any():
            raise InputError("pose_times_s: expected strictly increasing times, received poses out of order")
        transforms.require_rigid(self.world_T_ee, "world_T_ee")

    def __repr__(self) -> str:
        """One screen: sizes, times and counts, no pixels."""
        shape = " x ".join(map(str, self.images.shape[1:]))
        rows = [
            f"TrackedSweep({len(self.images)} frames of {shape} px, {len(self.world_T_ee)} poses,",
            *(
                f"    {name} {times_s[0]:.3f} to {times_s[-1]:.3f} s,"
                for name, times_s in (("frames", self.image_times_s), ("poses", self.pose_times_s))
                if len(times_s)
            ),
            f"    calibration.spacing_mm={tuple(round(each, 4) for each in self.calibration.spacing_mm)},",
            f"    dropped={dict(self.dropped)}, notes={len(self.notes)})",
        ]
        return "\n".join(rows)

    @property
    def frames_dropped(self) -> int:
        """How many recorded frames the reader left out."""
        return count_frames(self.dropped)

    @property
    def ee_A_pixel(self) -> Float64[np.ndarray, "n 4 4"]:
        """From each frame's pixel ``(column, row, 0, 1)`` to millimetres on the end effector."""
        shape = (len(self.images), 4, 4)
        if self.image_A_pixel is None:
            return np.broadcast_to(self.calibration.ee_A_pixel, shape)
        return np.asarray(self.calibration.ee_A_pixel @ self.image_A_pixel)

    def require_one_calibration(self, format: str) -> None:
        """Raise InputError where frames differ in calibration, which most formats of files cannot hold.

        Parameters
        ----------
        format : str
            Name of the format to write, for the message.

        Raises
        ------
        InputError
            If the frames differ in calibration.
        """
        if self.image_A_pixel is not None:
            raise InputError(
                f"sweep: expected one calibration for all frames to write {format}, received frames whose transforms "
                "from pixels differ (format=plus_mha keeps them)"
            )


@dataclass(frozen=True)
class PosedFrames:
    """The frames of a sweep that have a pose, with the pose brought to each frame's time.

    Parameters
    ----------
    kept : ndarray, shape (k,)
        Indices of these frames in the sweep's images.
    world_A_pixel : ndarray, shape (k, 4, 4)
        Map from a pixel ``(column, row, 0, 1)`` to mm in the world.
    dropped : dict of str to int
        The other frames, counted by reason.
    """

    kept: Int64[np.ndarray, " k"]
    world_A_pixel: Float64[np.ndarray, "k 4 4"]
    dropped: dict[str, int]

    __repr__ = brief_repr

    @property
    def frames_dropped(self) -> int:
        """How many recorded frames have no place."""
        return count_frames(self.dropped)

    def select(self, values: np.ndarray) -> np.ndarray:
        """Take what belongs to these frames.

        Parameters
        ----------
        values : ndarray, shape (n, ...)
            Something of each recorded frame, for instance its mask.

        Returns
        -------
        ndarray, shape (k, ...)
            What belongs to the frames that have a pose; where all have one, the array itself and no copy.
        """
        # Indices without repetition: as many as there are frames are all of them, in their order.
        return values if len(self.kept) == len(values) else values[self.kept]


def count_frames(dropped: Mapping[str, int]) -> int:
    """Count the frames among what was left out.

    Parameters
    ----------
    dropped : mapping of str to int
        Frames and poses left out, counted by reason.

    Returns
    -------
    int
        Number of frames; reasons that begin with ``pose:`` do not count.
    """
    return sum(count for reason, count in dropped.items() if not reason.startswith(POSE_DROPPED))
