"""Chain from tracked masks to a vessel's surface and centerline, shared by the studies, each stage timed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from registration.brief import brief_repr
from registration.errors import InputError
from registration.reconstruction.contours import ContourCloud, ContourExtractor
from registration.reconstruction.mask_outliers import MaskCheck, MaskOutliers
from registration.reconstruction.outlier_filters import Filtered
from registration.reconstruction.surface import SurfaceMethod
from registration.reconstruction.taubin import Smoothed, TaubinSmoothing
from registration.reconstruction.vessel_pieces import KeptPieces, VesselPieces

if TYPE_CHECKING:
    from registration.centerline.extractor import CenterlineExtractor
    from registration.geometry.shapes import Centerline, Mesh

STAGES = ("contours", "filters", "surface", "smoothing", "centerline")


def _silent(text: str) -> None:
    del text


@runtime_checkable
class CloudFilter(Protocol):
    """A filter of contour clouds."""

    def __call__(self, cloud: ContourCloud) -> Filtered[ContourCloud]:
        """Remove points.

        Parameters
        ----------
        cloud : ContourCloud
            Contour points.

        Returns
        -------
        Filtered
            The points that are left, and which were removed.
        """
        ...


@dataclass(frozen=True)
class Gathered:
    """Contour points of a sweep's masks, and the time that each stage took.

    Parameters
    ----------
    checked : MaskCheck
        The masks without the outliers.
    contours : ContourCloud
        All contour points in world mm.
    cloud : ContourCloud
        Points that the filters left.
    removed : mapping of str to int
        Number of points that each filter removed.
    seconds : mapping of str to float
        Seconds that each stage took.
    """

    checked: MaskCheck

    contours: ContourCloud
    cloud: ContourCloud
    removed: Mapping[str, int]
    seconds: Mapping[str, float]

    __repr__ = brief_repr


@dataclass(frozen=True)
class Reconstructed(Gathered):
    """Contour points with the surface and centerline that were made of them.

    Parameters
    ----------
    pieces : KeptPieces
        What was kept of the reconstructed surface.
    gap_mm : float
        Distance between image planes in mm from which on the method leaves a gap open.
    rough : Mesh
        The surface as reconstructed.
    smoothed : Smoothed
        The surface after smoothing.
    centerline : Centerline or None
        The centerline; None where none was asked for or the surface has none.
    refusal : str
        Why there is no centerline, else empty.
    """

    pieces: KeptPieces
    gap_mm: float
    rough: Mesh
    smoothed: Smoothed
    centerline: Centerline | None
    refusal: str

    __repr__ = brief_repr

    @property
    def surface(self) -> Mesh:
        """The smoothed surface."""
        return self.smoothed.mesh


def gather(
    masks: np.ndarray,
    world_A_pixel: np.ndarray,
    contours: ContourExtractor,
    filters: Mapping[str, CloudFilter],
    mask_outliers: MaskOutliers,
    note: Callable[[str], None] = _silent,
) -> Gathered:
    """Compute the filtered cloud of all contours: what a registration without a surface needs.

    Parameters
    ----------
    masks : ndarray of bool or float, shape (k, height, width)
        Masks or probability maps in the order of acquisition.
    world_A_pixel : ndarray, shape (k, 4, 4)
        Affine matrix of each mask from pixels to world mm.
    contours : ContourExtractor
        Extraction of contours.
    filters : mapping of str to CloudFilter
        Filters of the cloud by name, applied in their order.
    mask_outliers : MaskOutliers
        Rejection of masks that disagree with their neighbours.
    note : callable, optional
        Called with a line of text when a stage begins.

    Returns
    -------
    Gathered
        The masks without outliers, and the cloud.

    Raises
    ------
    InputError
        If no mask shows a vessel.
    """
    seconds: dict[str, float] = {}
    note(f"contours of {len(masks)} masks")
    with timed(seconds, "contours"):
        checked = mask_outliers(masks, world_A_pixel, contours.level)
        drawn = contours(checked.frames, world_A_pixel)
    if not len(drawn):
        raise InputError(f"masks: expected a vessel in some of them, received {len(masks)} without any")
    cloud, removed = drawn, {}
    with timed(seconds, "filters"):
        for name, leave_out in filters.items():
            left = leave_out(cloud)
            cloud, removed[name] = left.cloud, len(left.removed)
    return Gathered(checked, drawn, cloud, removed, seconds)


@dataclass(frozen=True)
class Reconstruction:
    """Chain from masks to contours, filtered cloud, smoothed surface and centerline.

    Parameters
    ----------
    contours : ContourExtractor
        Extraction of contours.
    filters : mapping of str to CloudFilter
        Filters of the cloud by name, applied in their order.
    surface : SurfaceMethod
        Reconstruction of the surface.
    smoothing : TaubinSmoothing
        Smoothing of the surface.
    centerline : CenterlineExtractor or None, optional
        Extraction of the centerline; None ends the chain with the surface.
    mask_outliers : MaskOutliers, optional
        Rejection of masks that disagree with their neighbours.
    pieces : VesselPieces, optional
        Selection of the vessel where the surface has several pieces.

    Raises
    ------
    InputError
        If ``filters`` is not a mapping of filters by name.
    """

    contours: ContourExtractor
    filters: Mapping[str, CloudFilter]
    surface: SurfaceMethod
    smoothing: TaubinSmoothing
    centerline: CenterlineExtractor | None = None
    mask_outliers: MaskOutliers = field(default_factory=MaskOutliers)
    pieces: VesselPieces = field(default_factory=VesselPieces)

    def __post_init__(self) -> None:
        if not isinstance(self.filters, Mapping) or not all(callable(one) for one in self.filters.values()):
            raise InputError(f"filters: expected filters by name, received {self.filters!r}")

    def __call__(
        self, masks: np.ndarray, world_A_pixel: np.ndarray, note: Callable[[str], None] = _silent
    ) -> Reconstructed:
        """Reconstruct a vessel from tracked masks.

        Parameters
        ----------
        masks : ndarray of bool or float, shape (k, height, width)
            Masks or probability maps in the order of acquisition.
        world_A_pixel : ndarray, shape (k, 4, 4)
            Affine matrix of each mask from pixels to world mm.
        note : callable, optional
            Called with a line of text when a stage begins.

        Returns
        -------
        Reconstructed
            Cloud, surface and centerline.

        Raises
        ------
        InputError
            If no mask shows a vessel, or a stage refuses its input.
        """
        return self.build(self.gather(masks, world_A_pixel, note), note)

    def gather(
        self, masks: np.ndarray, world_A_pixel: np.ndarray, note: Callable[[str], None] = _silent
    ) -> Gathered:
        """Compute the filtered cloud of all contours, the first half of the chain.

        Parameters
        ----------
        masks : ndarray of bool or float, shape (k, height, width)
            Masks or probability maps in the order of acquisition.
        world_A_pixel : ndarray, shape (k, 4, 4)
            Affine matrix of each mask from pixels to world mm.
        note : callable, optional
            Called with a line of text when a stage begins.

        Returns
        -------
        Gathered
            The masks without outliers, and the cloud.

        Raises
        ------
        InputError
            If no mask shows a vessel.
        """
        return gather(masks, world_A_pixel, self.contours, self.filters, self.mask_outliers, note)

    def build(self, gathered: Gathered, note: Callable[[str], None] = _silent) -> Reconstructed:
        """Compute surface and centerline of a cloud, the second half of the chain.

        Parameters
        ----------
        gathered : Gathered
            Result of ``gather``.
        note : callable, optional
            Called with a line of text when a stage begins.

        Returns
        -------
        Reconstructed
            Cloud, surface and centerline. A surface without a centerline is no error: ``refusal`` has the
            reason.
        """
        seconds = dict(gathered.seconds)
        note(f"surface through {len(gathered.cloud)} points")
        with timed(seconds, "surface"):
            pieces = self.pieces(self.surface(gathered.cloud))
        with timed(seconds, "smoothing"):
            smoothed = self.smoothing(pieces.mesh)
        centerline, refusal = None, "none was asked for"
        if self.centerline is not None:
            note(f"centerline of {len(smoothed.mesh.triangles)} triangles")
            with timed(seconds, "centerline"):
                centerline, refusal = _centerline(self.centerline, smoothed.mesh)
        return Reconstructed(
            gathered.checked,
            gathered.contours,
            gathered.cloud,
            gathered.removed,
            seconds,
            pieces,
            # A method without such a width has no limit: no step between frames then counts as a gap.
            float(getattr(self.surface, "bridge_mm", 0.0)) or np.inf,
            pieces.mesh,
            smoothed,
            centerline,
            refusal,
        )


def _centerline(extract: CenterlineExtractor, surface: Mesh) -> tuple[Centerline | None, str]:
    """The centerline, or none and why: a surface is of use without one."""
    try:
        return extract(surface), ""
    except InputError as refusal:
        return None, str(refusal)


@contextmanager
def timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Record the seconds that the block takes.

    Parameters
    ----------
    seconds : dict of str to float
        Where the time is recorded, under the name of the stage.
    stage : str
        Name of the stage.
    """
    begin_s = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - begin_s
