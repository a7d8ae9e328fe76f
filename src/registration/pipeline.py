"""The chain from tracked masks to a vessel's surface and centerline, as the studies share it, each stage timed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

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
    """What every filter is: a call from a cloud to what is left of it and what is not."""

    def __call__(self, cloud: ContourCloud) -> Filtered[ContourCloud]:
        """Leave points out."""
        ...


@dataclass(frozen=True)
class Gathered:
    """The points of a sweep's masks, in the world, and how long each stage took.

    ``checked`` are the masks without those that disagree with their neighbours. ``contours`` are all points found,
    ``cloud`` those that the filters left; ``removed`` counts the others by filter. ``seconds`` has an entry a stage.
    """

    checked: MaskCheck

    contours: ContourCloud
    cloud: ContourCloud
    removed: Mapping[str, int]
    seconds: Mapping[str, float]


@dataclass(frozen=True)
class Reconstructed(Gathered):
    """What was gathered, and the surface and centerline made of it.

    ``pieces`` tells what of the reconstructed surface was kept, ``gap_mm`` from which distance on the method leaves a
    gap between frames open. ``rough`` is the surface as reconstructed and ``smoothed`` the one after. ``centerline`` is
    None where none was asked for, or where the surface has none: ``refusal`` says why.
    """

    pieces: KeptPieces
    gap_mm: float
    rough: Mesh
    smoothed: Smoothed
    centerline: Centerline | None
    refusal: str

    @property
    def surface(self) -> Mesh:
        """The surface, smoothed."""
        return self.smoothed.mesh


@dataclass(frozen=True)
class Reconstruction:
    """Masks that agree to contours to a filtered cloud to a smoothed surface to its centerline.

    ``filters`` are applied in their order. ``pieces`` keeps what belongs to the vessel of a surface that came in
    pieces. Without ``centerline`` the chain ends with the surface.
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
        """Reconstruct from masks (k, height, width), bool or probabilities, and their transforms (k, 4, 4).

        ``note`` is told what begins. Raises InputError where no mask shows a vessel, and what the stages refuse.
        """
        return self.build(self.gather(masks, world_A_pixel, note), note)

    def gather(
        self, masks: np.ndarray, world_A_pixel: np.ndarray, note: Callable[[str], None] = _silent
    ) -> Gathered:
        """The first half: the filtered cloud of all contours."""
        seconds: dict[str, float] = {}
        note(f"contours of {len(masks)} masks")
        with timed(seconds, "contours"):
            checked = self.mask_outliers(masks, world_A_pixel, self.contours.level)
            contours = self.contours(checked.masks, world_A_pixel)
        if not len(contours):
            raise InputError(f"masks: expected a vessel in some of them, received {len(masks)} without any")
        cloud, removed = contours, {}
        with timed(seconds, "filters"):
            for name, leave_out in self.filters.items():
                left = leave_out(cloud)
                cloud, removed[name] = left.cloud, len(left.removed)
        return Gathered(checked, contours, cloud, removed, seconds)

    def build(self, gathered: Gathered, note: Callable[[str], None] = _silent) -> Reconstructed:
        """The second half: surface and centerline of a cloud."""
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
            # A method without such a width closes no gap knowingly: then no step between frames is called one.
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
    """Put the seconds that the block takes into ``seconds`` under the name of the stage."""
    begin_s = time.perf_counter()
    yield
    seconds[stage] = time.perf_counter() - begin_s
