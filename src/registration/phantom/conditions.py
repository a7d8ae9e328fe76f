"""How the probe moves, how the tissue gives way, and what the preoperative CT is like.

Lengths are in mm, angles in degrees, times in seconds. Sources of the defaults: 0.1 mm is the repeatability that makers
of collaborative arms state (ISO 9283); a robotic ultrasound reconstruction of femoral phantoms was 0.9 mm off the CT's
centerline on average (Al-Zogbi et al., arXiv 2503.06795, 2025), which bounds all errors of a scan together; clinical CT
angiography has voxels of 0.5 to 1 mm.
"""

from __future__ import annotations

from dataclasses import dataclass

from registration.checks import require_at_least, require_count, require_positive
from registration.errors import InputError


@dataclass(frozen=True)
class Motion:
    """Motion of the probe, and how accurately its poses are known.

    Parameters
    ----------
    frames : int, optional
        Number of frames, evenly spaced over the sweep; at least 2.
    duration_s : float, optional
        Duration of the sweep in s.
    pose_rate_hz : float, optional
        Rate at which poses are recorded in Hz.
    length_mm : float, optional
        Length of the sweep along the vessel in mm.
    tilt_deg : float, optional
        Size of the probe's tilt in degrees.
    wander_mm : float, optional
        Standard deviation of the lateral wander in mm.
    noise_mm, noise_deg : float, optional
        Standard deviation of the pose noise per coordinate, in mm and in degrees; Gaussian and independent
        for each pose.
    latency_s : float, optional
        Delay in s of an image's time stamp against the pose clock.
    calibration_mm, calibration_deg : float, optional
        Error of the recorded calibration in mm and in degrees, in a random direction.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    frames: int = 60
    duration_s: float = 10.0
    pose_rate_hz: float = 100.0
    length_mm: float = 60.0
    tilt_deg: float = 6.0
    wander_mm: float = 2.0
    noise_mm: float = 0.1
    noise_deg: float = 0.1
    latency_s: float = 0.0
    calibration_mm: float = 0.0
    calibration_deg: float = 0.0

    def __post_init__(self) -> None:
        require_count("frames", self.frames, 2)
        for name in ("duration_s", "pose_rate_hz", "length_mm"):
            require_positive(name, getattr(self, name))
        for name in ("tilt_deg", "wander_mm", "noise_mm", "noise_deg", "calibration_mm", "calibration_deg"):
            require_at_least(name, getattr(self, name), 0.0)


@dataclass(frozen=True)
class Deformation:
    """Difference between the vessel's shape at the sweep and in the CT; 0 switches a part off.

    Parameters
    ----------
    bend_mm : float, optional
        Largest displacement along the vessel in mm by a smooth field (patient and limb lie differently), its
        rigid part removed; at most 0.4 of ``bend_length_mm``.
    bend_length_mm : float, optional
        Length in mm over which the field varies.
    pressure_mm : float, optional
        Depth in mm to which the probe presses; at most 0.4 of ``pressure_depth_mm``.
    pressure_depth_mm : float, optional
        Decay length of the push with depth in mm.
    squeeze : float or None, optional
        Share of its depth by which the vessel flattens at full pressure, 0 to 0.5. None: 0.25 for a vein,
        which any pressure closes, 0.05 for other vessels.

    Raises
    ------
    InputError
        If a value is out of range, or a field is so steep that it would fold the tissue over itself.
    """

    bend_mm: float = 2.0
    bend_length_mm: float = 22.0
    pressure_mm: float = 1.5
    pressure_depth_mm: float = 25.0
    squeeze: float | None = None

    def __post_init__(self) -> None:
        for name in ("bend_mm", "pressure_mm"):
            require_at_least(name, getattr(self, name), 0.0)
        for name in ("bend_length_mm", "pressure_depth_mm"):
            require_positive(name, getattr(self, name))
        # Steeper fields would fold the tissue over itself.
        if self.bend_mm > 0.4 * self.bend_length_mm:
            raise InputError(
                f"bend_mm: expected at most 0.4 of bend_length_mm={self.bend_length_mm:g}, received {self.bend_mm:g}"
            )
        if self.pressure_mm > 0.4 * self.pressure_depth_mm:
            raise InputError(
                f"pressure_mm: expected at most 0.4 of pressure_depth_mm={self.pressure_depth_mm:g}, "
                f"received {self.pressure_mm:g}"
            )
        if self.squeeze is not None and not 0 <= self.squeeze <= 0.5:
            raise InputError(f"squeeze: expected 0 to 0.5 or none, received {self.squeeze!r}")


@dataclass(frozen=True)
class CtScan:
    """Preoperative CT that the fixed model is re-segmented from.

    Parameters
    ----------
    voxel_mm : float, optional
        In-plane voxel size in mm.
    slice_mm : float, optional
        Slice spacing in mm.
    blur_mm : float, optional
        Standard deviation of the scanner's resolution in mm.
    contrast_hu : float, optional
        Contrast of the vessel against its surroundings in HU.
    noise_hu : float, optional
        Standard deviation of the noise in HU.
    crop_mm : float, optional
        Length in mm that is cut off both ends of the vessel.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    voxel_mm: float = 0.7
    slice_mm: float = 1.0
    blur_mm: float = 0.6
    contrast_hu: float = 300.0
    noise_hu: float = 15.0
    crop_mm: float = 3.0

    def __post_init__(self) -> None:
        for name in ("voxel_mm", "slice_mm", "contrast_hu"):
            require_positive(name, getattr(self, name))
        for name in ("blur_mm", "noise_hu", "crop_mm"):
            require_at_least(name, getattr(self, name), 0.0)
