"""What makes a registration err, each switched on or off by itself: masks, poses, sound speed, CT and tissue."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool
from scipy.ndimage import distance_transform_edt, gaussian_filter

from registration.checks import require_at_least, require_positive
from registration.errors import InputError
from registration.phantom.acoustics import ASSUMED_SPEED_M_S
from registration.phantom.conditions import CtScan, Deformation
from registration.phantom.settings import PhantomSettings

MASK_BIAS, WALL_LOSS, LAG, CALIBRATION, SOUND_SPEED, CT, DEFORMATION = SOURCES = (
    "mask_bias",
    "wall_loss",
    "lag",
    "calibration",
    "sound_speed",
    "ct",
    "deformation",
)
# Frames in a row that lose the same side of the wall.
RUN_FRAMES = 8
# Random errors of a border hang together over so many pixels.
BORDER_PX = 6.0
# A CT without errors of its own, as far as its voxels allow.
FINE_CT = CtScan(voxel_mm=0.4, slice_mm=0.5, blur_mm=0.2, noise_hu=0.0)


@dataclass(frozen=True)
class ErrorSources:
    """Size of each source of error when it is on; when it is off there is none.

    Parameters
    ----------
    mask_bias_mm : float, optional
        By how far every mask's border lies outside the vessel's, in mm; negative for inside.
    wall_loss_share : float, optional
        Share of the vessel's width by which a mask ends before one of the side walls, which the scanner hardly shows;
        in runs of frames, on either side.
    lag_s : float, optional
        Delay in s of an image's time stamp against the pose clock.
    calibration_mm, calibration_deg : float, optional
        Error of the recorded calibration in mm and in degrees.
    sound_speed_m_s : float, optional
        True speed of sound in m/s, where the scanner assumes 1540.
    ct : CtScan, optional
        The CT that the model is segmented from; when off, it has voxels of 0.4 x 0.4 x 0.5 mm, hardly any blur and no
        noise.
    deformation : Deformation, optional
        Deformation of the tissue between CT and sweep.

    Raises
    ------
    InputError
        If a size is out of range.
    """

    mask_bias_mm: float = 0.3
    wall_loss_share: float = 0.25
    lag_s: float = 0.05
    calibration_mm: float = 1.0
    calibration_deg: float = 1.0
    sound_speed_m_s: float = 1480.0
    ct: CtScan = field(default_factory=CtScan)
    deformation: Deformation = field(default_factory=Deformation)

    def __post_init__(self) -> None:
        if not np.isfinite(self.mask_bias_mm):
            raise InputError(f"mask_bias_mm: expected a length, received {self.mask_bias_mm}")
        for name in ("lag_s", "calibration_mm", "calibration_deg"):
            require_at_least(name, getattr(self, name), 0.0)
        require_positive("sound_speed_m_s", self.sound_speed_m_s)
        if not 0 <= self.wall_loss_share < 1:
            raise InputError(
                f"wall_loss_share: expected a share from 0 to below 1, received {self.wall_loss_share}"
            )

    def settings_with(self, phantom: PhantomSettings, on: Collection[str]) -> PhantomSettings:
        """Switch the sources that are not of the masks.

        Parameters
        ----------
        phantom : PhantomSettings
            Settings of the phantom; what no source concerns is kept.
        on : collection of str
            Sources that are on, of ``SOURCES``.

        Returns
        -------
        PhantomSettings
            The settings.

        Raises
        ------
        InputError
            If there is no such source.
        """
        _require_known(on)
        off = Deformation(bend_mm=0.0, pressure_mm=0.0)
        return replace(
            phantom,
            motion=replace(
                phantom.motion,
                latency_s=self.lag_s if LAG in on else 0.0,
                calibration_mm=self.calibration_mm if CALIBRATION in on else 0.0,
                calibration_deg=self.calibration_deg if CALIBRATION in on else 0.0,
            ),
            tissue=replace(
                phantom.tissue,
                sound_speed_m_s=self.sound_speed_m_s if SOUND_SPEED in on else ASSUMED_SPEED_M_S,
            ),
            ct=self.ct if CT in on else replace(FINE_CT, crop_mm=self.ct.crop_mm),
            deformation=self.deformation if DEFORMATION in on else off,
        )

    def masks_with(
        self,
        masks: Bool[np.ndarray, "n h w"],
        on: Collection[str],
        spacing_mm: tuple[float, float],
        rng: np.random.Generator,
    ) -> Bool[np.ndarray, "n h w"]:
        """Switch the sources of the masks.

        Parameters
        ----------
        masks : ndarray of bool, shape (n, h, w)
            Exact masks.
        on : collection of str
            Sources that are on, of ``SOURCES``.
        spacing_mm : tuple of float
            Size of a pixel in mm, rows first.
        rng : numpy.random.Generator
            Random stream of which side of the wall is lost.

        Returns
        -------
        ndarray of bool, shape (n, h, w)
            Masks with the errors.

        Raises
        ------
        InputError
            If there is no such source.
        """
        _require_known(on)
        if WALL_LOSS in on:
            masks = _without_a_side(masks, self.wall_loss_share, rng)
        if MASK_BIAS in on:
            masks = shifted_borders(masks, self.mask_bias_mm, 0.0, spacing_mm, rng)
        return masks


def shifted_borders(
    masks: Bool[np.ndarray, "n h w"],
    bias_mm: float,
    deviation_mm: float,
    spacing_mm: tuple[float, float],
    rng: np.random.Generator,
) -> Bool[np.ndarray, "n h w"]:
    """Shift the borders of masks along their normals.

    Parameters
    ----------
    masks : ndarray of bool, shape (n, h, w)
        Masks.
    bias_mm : float
        Shift in mm everywhere, outwards where positive.
    deviation_mm : float
        Standard deviation in mm of a further shift that varies along the border and from frame to frame.
    spacing_mm : tuple of float
        Size of a pixel in mm, rows first.
    rng : numpy.random.Generator
        Random stream of that shift.

    Returns
    -------
    ndarray of bool, shape (n, h, w)
        Masks with shifted borders; an empty mask stays empty.
    """
    shifted = np.zeros_like(masks)
    for number, mask in enumerate(masks):
        if not mask.any():
            continue
        # Positive outside; the border lies half a pixel from the outermost pixels of either side.
        away_mm = distance_transform_edt(~mask, spacing_mm) - distance_transform_edt(mask, spacing_mm)
        shift_mm = np.full(mask.shape, bias_mm)
        if deviation_mm:
            noise = gaussian_filter(rng.standard_normal(mask.shape), BORDER_PX)
            shift_mm += deviation_mm * noise / noise.std()
        shifted[number] = away_mm < shift_mm + 1e-9
    return shifted


def _without_a_side(masks: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Masks that end before one of their side walls; the side changes from run to run of frames."""
    cut = masks.copy()
    sides = rng.random(-(-len(masks) // RUN_FRAMES)) < 0.5
    for number, mask in enumerate(masks):
        columns = np.flatnonzero(mask.any(axis=0))
        if not len(columns):
            continue
        lost = round(share * len(columns))
        if sides[number // RUN_FRAMES]:
            cut[number][:, columns[0] : columns[0] + lost] = False
        else:
            cut[number][:, columns[-1] + 1 - lost : columns[-1] + 1] = False
    return cut


def _require_known(on: Collection[str]) -> None:
    unknown = sorted(set(on) - set(SOURCES))
    if unknown:
        raise InputError(f"sources: expected of {', '.join(SOURCES)}, received {', '.join(unknown)}")
