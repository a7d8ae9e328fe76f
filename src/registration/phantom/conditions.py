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
    """How the robot moves the probe and how well its poses are known.

    ``frames`` are taken evenly over ``duration_s``, poses at a rate of their own. ``latency_s`` is how late an image's
    time stamp is against the pose clock. Pose noise is Gaussian and independent for each pose. The recorded
    calibration is off by ``calibration_mm`` and ``calibration_deg``, in a random direction.
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
    """How the vessel's shape at the sweep differs from the CT's; 0 switches a part off.

    ``bend_mm``: the largest displacement along the vessel by a smooth field (patient and limb lie differently), its
    rigid part taken out, varying over ``bend_length_mm``. ``pressure_mm``: how deep the probe presses, a push that
    fades over ``pressure_depth_mm``; ``squeeze``: share of its depth by which the vessel flattens at full pressure
    (None: 0.25 for a vein, which any pressure closes, 0.05 for other vessels).
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
    """The preoperative CT that the fixed model is re-segmented from; ``crop_mm`` is cut off both ends."""

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
