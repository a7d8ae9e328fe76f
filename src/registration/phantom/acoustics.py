"""What the simulated scanner is, what the tissue sends back, and what goes wrong on the way.

Lengths are in mm, levels in dB against average tissue. Sources of the defaults: attenuation of muscle, fat and blood
from the tables in Diagnostics 13(5), 855 (2023): 0.96, 0.63 and 0.15 dB/cm/MHz, halved for what a scanner's slice
through mixed tissue shows (0.5 is the usual round value); wall 0.4 to 0.9 mm, the thickness of intima and media in
adults; contrast, haze and grain are such that vessels look as they do in the public images of usgra-seg (CC BY 4.0):
gCNR (Rodriguez-Molares et al., IEEE T-UFFC 67, 2020) between lumen and surroundings 0.3 to 0.8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.checks import require_at_least, require_count, require_positive
from registration.errors import InputError

GEOMETRIES = ("linear", "convex")
ASSUMED_SPEED_M_S = 1540.0


@dataclass(frozen=True)
class Scanner:
    """The probe and the machine.

    A ``linear`` array, or a ``convex`` one of curvature ``radius_mm``, ``aperture_mm`` long. The pulse is a Gaussian of
    ``pulse_cycles``, the beam one of f-number ``f_number``, narrowest at ``focus_mm``; ``elevation_mm`` is the slice's
    full width at half maximum at its own focus. ``looks`` pictures from different directions are averaged (compounding;
    1 gives raw speckle). Grey is the level in dB over ``dynamic_range_db``, raised to ``gamma``.
    """

    geometry: str = "linear"
    height_px: int = 256
    width_px: int = 256
    depth_mm: float = 40.0
    aperture_mm: float = 40.0
    radius_mm: float = 60.0
    frequency_mhz: float = 9.0
    pulse_cycles: float = 1.8
    f_number: float = 3.0
    focus_mm: float = 18.0
    looks: int = 3
    elevation_mm: float = 2.4
    elevation_focus_mm: float = 20.0
    dynamic_range_db: float = 66.0
    gamma: float = 1.6
    gain_db: float = 0.0
    noise_db: float = -19.0

    def __post_init__(self) -> None:
        if self.geometry not in GEOMETRIES:
            raise InputError(f"geometry: expected one of {', '.join(GEOMETRIES)}, received {self.geometry!r}")
        require_count("height_px", self.height_px, 16)
        require_count("width_px", self.width_px, 16)
        require_count("looks", self.looks, 1)
        for name in ("depth_mm", "aperture_mm", "radius_mm", "frequency_mhz", "pulse_cycles", "f_number"):
            require_positive(name, getattr(self, name))
        for name in ("focus_mm", "elevation_mm", "elevation_focus_mm", "dynamic_range_db", "gamma"):
            require_positive(name, getattr(self, name))
        if self.geometry == "convex" and self.aperture_mm >= np.pi * self.radius_mm:
            raise InputError(
                f"aperture_mm: expected less than half a circle of radius_mm={self.radius_mm:g}, "
                f"received {self.aperture_mm:g}"
            )

    @property
    def sag_mm(self) -> float:
        """How far the ends of the array lie behind its middle; 0 for a linear one."""
        if self.geometry == "linear":
            return 0.0
        return float(self.radius_mm * (1.0 - np.cos(0.5 * self.aperture_mm / self.radius_mm)))

    @property
    def pixel_mm(self) -> float:
        """Side of a square pixel."""
        return (self.depth_mm + self.sag_mm) / self.height_px

    @property
    def wavelength_mm(self) -> float:
        """Wavelength at the speed of sound that the scanner assumes."""
        return ASSUMED_SPEED_M_S / self.frequency_mhz / 1000.0


@dataclass(frozen=True)
class Tissue:
    """What scatters, where, and how much.

    ``texture_db`` and ``mottle_db`` are the deviations of fine and coarse variation in brightness. The wall's echo
    falls as ``|cos|**wall_exponent`` with the angle of incidence, so that side walls drop out (0 switches that off).
    ``fascia_count`` continuous sheets run along the skin; ``streaks_per_mm`` short ones lie between them.
    ``sound_speed_m_s`` is the true speed: the scanner assumes 1540 and misplaces depth by their ratio.
    """

    scatterers_per_mm3: float = 24.0
    texture_db: float = 4.0
    mottle_db: float = 2.5
    lumen_db: float = -30.0
    wall_mm: float = 0.7
    wall_echo_db: float = 17.0
    wall_exponent: float = 4.0
    fascia_count: int = 4
    fascia_db: float = 15.0
    streaks_per_mm: float = 0.9
    streak_db: float = 11.0
    attenuation_db_cm_mhz: float = 0.5
    compensation_db_cm_mhz: float = 0.36
    sound_speed_m_s: float = 1540.0

    def __post_init__(self) -> None:
        for name in ("scatterers_per_mm3", "wall_mm", "sound_speed_m_s"):
            require_positive(name, getattr(self, name))
        for name in ("texture_db", "mottle_db", "wall_exponent", "streaks_per_mm", "attenuation_db_cm_mhz"):
            require_at_least(name, getattr(self, name), 0.0)
        require_at_least("compensation_db_cm_mhz", self.compensation_db_cm_mhz, 0.0)
        require_count("fascia_count", self.fascia_count, 0)


@dataclass(frozen=True)
class Artefacts:
    """What hides or fakes structure; each is switched off by the value in brackets.

    ``clutter_db`` [-120]: haze from side lobes and scattering off the path. ``reverberation_db`` [-120]: a second copy
    of everything ``reverberation_mm`` deeper. ``contact_loss_mm`` [0]: typical width over which the array's ends lose
    coupling now and then. ``shadows`` [0]: number of hard spots ``shadow_mm`` wide in the tissue that nothing is seen
    behind. ``edge_shadow`` [1]: how much more the flanks of the vessel attenuate, by refraction.
    """

    clutter_db: float = -21.0
    reverberation_db: float = -33.0
    reverberation_mm: float = 3.4
    contact_loss_mm: float = 4.0
    shadows: int = 4
    shadow_mm: float = 2.2
    edge_shadow: float = 5.0

    def __post_init__(self) -> None:
        require_positive("reverberation_mm", self.reverberation_mm)
        require_positive("shadow_mm", self.shadow_mm)
        require_at_least("contact_loss_mm", self.contact_loss_mm, 0.0)
        require_at_least("edge_shadow", self.edge_shadow, 1.0)
        require_count("shadows", self.shadows, 0)
