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
    """Ultrasound probe and scanner.

    The pulse and the beam are Gaussian; the grey level is the level in dB over ``dynamic_range_db``, raised
    to ``gamma``.

    Parameters
    ----------
    geometry : {"linear", "convex"}, optional
        Shape of the array.
    height_px, width_px : int, optional
        Size of the image in px, at least 16 each.
    depth_mm : float, optional
        Imaging depth below the face in mm.
    aperture_mm : float, optional
        Length of the array along its face in mm.
    radius_mm : float, optional
        Radius of curvature of a convex array in mm; has no effect on a linear one.
    frequency_mhz : float, optional
        Centre frequency in MHz.
    pulse_cycles : float, optional
        Length of the Gaussian pulse in cycles.
    f_number : float, optional
        F-number of the beam at its focus.
    focus_mm : float, optional
        Depth in mm at which the beam is narrowest.
    looks : int, optional
        Number of images from different directions that are averaged (compounding); 1 gives raw speckle.
    elevation_mm : float, optional
        Slice thickness in mm: full width at half maximum at the elevation focus.
    elevation_focus_mm : float, optional
        Depth of the elevation focus in mm.
    dynamic_range_db : float, optional
        Range of levels in dB that the grey scale shows.
    gamma : float, optional
        Exponent of the grey curve.
    gain_db : float, optional
        Overall gain in dB.
    noise_db : float, optional
        Level of the receiver's noise at ``depth_mm`` in dB against average tissue.

    Raises
    ------
    InputError
        If the geometry is unknown, a size is out of range, or a convex array spans half a circle or more.
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
        """Distance in mm by which the ends of the array lie behind its middle; 0 for a linear one."""
        if self.geometry == "linear":
            return 0.0
        return float(self.radius_mm * (1.0 - np.cos(0.5 * self.aperture_mm / self.radius_mm)))

    @property
    def pixel_mm(self) -> float:
        """Side of a square pixel in mm."""
        return (self.depth_mm + self.sag_mm) / self.height_px

    @property
    def wavelength_mm(self) -> float:
        """Wavelength in mm at the speed of sound that the scanner assumes."""
        return ASSUMED_SPEED_M_S / self.frequency_mhz / 1000.0


@dataclass(frozen=True)
class Tissue:
    """Acoustic properties of the tissue, the vessel wall and the lumen.

    Parameters
    ----------
    scatterers_per_mm3 : float, optional
        Number of scatterers per mm3.
    texture_db, mottle_db : float, optional
        Standard deviation in dB of fine and of coarse variation in brightness.
    lumen_db : float, optional
        Level of the lumen in dB against average tissue.
    wall_mm : float, optional
        Thickness of the vessel wall in mm.
    wall_echo_db : float, optional
        Echo of the wall in dB at normal incidence.
    wall_exponent : float, optional
        The wall's echo falls as ``|cos|**wall_exponent`` with the angle of incidence, so that side walls drop
        out; 0 switches that off.
    fascia_count : int, optional
        Number of continuous sheets along the skin.
    fascia_db : float, optional
        Echo of these sheets in dB.
    streaks_per_mm : float, optional
        Number of short sheets between them per mm of depth.
    streak_db : float, optional
        Echo of the short sheets in dB.
    attenuation_db_cm_mhz : float, optional
        Attenuation of average tissue in dB/cm/MHz.
    compensation_db_cm_mhz : float, optional
        Depth gain by which the scanner compensates it, in dB/cm/MHz.
    sound_speed_m_s : float, optional
        True speed of sound in m/s; the scanner assumes 1540 and misplaces depth by their ratio.

    Raises
    ------
    InputError
        If a value is out of range.
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
    """Artefacts that hide or imitate structure.

    Parameters
    ----------
    clutter_db : float, optional
        Level in dB of haze from side lobes and multipath scattering; -120 switches it off.
    reverberation_db : float, optional
        Level in dB of a second copy of everything, ``reverberation_mm`` deeper; -120 switches it off.
    reverberation_mm : float, optional
        Depth offset of that copy in mm.
    contact_loss_mm : float, optional
        Typical width in mm over which the ends of the array intermittently lose coupling; 0 switches it off.
    shadows : int, optional
        Number of hard spots in the tissue that cast an acoustic shadow; 0 switches them off.
    shadow_mm : float, optional
        Diameter of a hard spot in mm.
    edge_shadow : float, optional
        Factor by which the flanks of the vessel attenuate more, by refraction; 1 switches it off.

    Raises
    ------
    InputError
        If a value is out of range.
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
