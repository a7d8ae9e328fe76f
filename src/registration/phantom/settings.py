"""Everything the simulator can be told, in four groups; lengths in mm, angles in degrees, times in seconds."""

from __future__ import annotations

from dataclasses import dataclass, field

from registration.errors import InputError

TISSUE_SPEED_M_S = 1540.0
SUBSETS = ("artificial", "vein", "artery")


def require(condition: bool, name: str, expected: str, received: object) -> None:
    """Raise InputError in the words used for every setting unless ``condition`` holds."""
    if not condition:
        raise InputError(f"{name}: expected {expected}, received {received!r}")


@dataclass(frozen=True)
class Scanner:
    """The probe and the machine.

    A linear array ``aperture_mm`` wide, 7.5 MHz, as used on vessels of the neck and the groin. The point-spread
    function is a Gaussian pulse of ``pulse_cycles`` and a Gaussian beam of f-number ``f_number``, narrowest at
    ``focus_mm``; ``elevation_mm`` is the slice's full width at half maximum at its focus.
    """

    height_px: int = 256
    width_px: int = 256
    depth_mm: float = 40.0
    aperture_mm: float = 40.0
    frequency_mhz: float = 7.5
    pulse_cycles: float = 3.5
    f_number: float = 3.0
    focus_mm: float = 18.0
    elevation_mm: float = 2.4
    elevation_focus_mm: float = 20.0
    dynamic_range_db: float = 60.0
    gain_db: float = 0.0
    noise_db: float = -46.0
    clutter_db: float = -33.0

    def __post_init__(self) -> None:
        for name in ("height_px", "width_px"):
            require(getattr(self, name) >= 16, name, "at least 16 pixels", getattr(self, name))
        for name in (
            "depth_mm",
            "aperture_mm",
            "frequency_mhz",
            "pulse_cycles",
            "f_number",
            "focus_mm",
            "elevation_mm",
            "elevation_focus_mm",
            "dynamic_range_db",
        ):
            require(getattr(self, name) > 0, name, "a positive number", getattr(self, name))

    @property
    def pixel_mm(self) -> float:
        """Side of a square pixel."""
        return self.depth_mm / self.height_px

    @property
    def wavelength_mm(self) -> float:
        """Wavelength in tissue at 1540 m/s."""
        return TISSUE_SPEED_M_S / self.frequency_mhz / 1000.0


@dataclass(frozen=True)
class Tissue:
    """What scatters, where, and how much; levels in dB against average tissue."""

    scatterers_per_mm3: float = 16.0
    texture_db: float = 3.0
    texture_mm: float = 3.0
    lumen_db: float = -34.0
    wall_mm: float = 0.8
    wall_echo_db: float = 14.0
    wall_exponent: float = 4.0
    fascia_count: int = 12
    fascia_db: float = 12.0
    attenuation_db_cm_mhz: float = 0.5
    compensation_db_cm_mhz: float = 0.46

    def __post_init__(self) -> None:
        require(
            self.scatterers_per_mm3 > 0, "scatterers_per_mm3", "a positive number", self.scatterers_per_mm3
        )
        require(self.fascia_count >= 0, "fascia_count", "0 or more", self.fascia_count)
        require(self.texture_mm > 0, "texture_mm", "a positive number", self.texture_mm)
        require(self.wall_mm > 0, "wall_mm", "a positive number", self.wall_mm)


@dataclass(frozen=True)
class Motion:
    """How the robot moves the probe and how well its poses are known.

    ``frames`` are taken evenly over ``duration_s``, poses at a rate of their own. ``latency_s`` is how late an image's
    time stamp is against the pose clock. Noise is Gaussian and independent for each pose; 0.1 mm is the repeatability that makers of collaborative
    arms state (ISO 9283).
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

    def __post_init__(self) -> None:
        require(self.frames >= 2, "frames", "at least 2", self.frames)
        for name in ("duration_s", "pose_rate_hz", "length_mm"):
            require(getattr(self, name) > 0, name, "a positive number", getattr(self, name))
        for name in ("tilt_deg", "wander_mm", "noise_mm", "noise_deg"):
            require(getattr(self, name) >= 0, name, "0 or more", getattr(self, name))

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second."""
        return self.frames / self.duration_s


@dataclass(frozen=True)
class CtScan:
    """The preoperative CT that the fixed model is re-segmented from."""

    voxel_mm: float = 0.7
    slice_mm: float = 1.0
    blur_mm: float = 0.6
    contrast_hu: float = 300.0
    noise_hu: float = 15.0
    crop_mm: float = 3.0

    def __post_init__(self) -> None:
        for name in ("voxel_mm", "slice_mm", "contrast_hu"):
            require(getattr(self, name) > 0, name, "a positive number", getattr(self, name))
        for name in ("blur_mm", "noise_hu", "crop_mm"):
            require(getattr(self, name) >= 0, name, "0 or more", getattr(self, name))


@dataclass(frozen=True)
class PhantomSettings:
    """One simulated phantom: its vessel, tissue, scanner, motion and CT; ``seed`` decides all that is random."""

    subset: str = "artery"
    seed: int = 0
    scanner: Scanner = field(default_factory=Scanner)
    tissue: Tissue = field(default_factory=Tissue)
    motion: Motion = field(default_factory=Motion)
    ct: CtScan = field(default_factory=CtScan)

    def __post_init__(self) -> None:
        require(self.subset in SUBSETS, "subset", f"one of {', '.join(SUBSETS)}", self.subset)
        require(self.seed >= 0, "seed", "0 or more", self.seed)
        for name, kind in (("scanner", Scanner), ("tissue", Tissue), ("motion", Motion), ("ct", CtScan)):
            value = getattr(self, name)
            require(isinstance(value, kind), name, f"a {kind.__name__}", type(value).__name__)
