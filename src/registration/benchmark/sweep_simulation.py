"""The sweep behind a case: an anatomy, the masks of its frames, the points of these, and the model from its CT.

Unless a block of cases says otherwise, tissue does not deform: a rigid pose is the whole truth. Everything else is as
the simulator and the reconstruction have it by default: noisy poses, a CT of 0.7 x 0.7 x 1 mm, sub-pixel contours,
three filters. These settings belong to the benchmark and are written down here, so that it stays what it is when the
defaults change.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64

from registration import transforms
from registration.benchmark.scenarios import Kind
from registration.benchmark.symmetric_shapes import SHAPES, SymmetricShape
from registration.benchmark.symmetry import Symmetry
from registration.errors import InputError
from registration.geometry.point_cloud import take
from registration.geometry.shapes import Centerline, Polyline
from registration.io.surfaces import write_surface
from registration.metrics.targets import MAX_TARGETS
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.displacement import Displacement
from registration.phantom.material_error import passed
from registration.phantom.scan import SimulatedSweep, simulate_sweep
from registration.phantom.settings import MESH, RANDOM, PhantomSettings
from registration.phantom.shapes import VesselLine, surround
from registration.reconstruction.contours import ContourCloud, ContourExtractor
from registration.reconstruction.outlier_filters import (
    RadiusOutlierRemoval,
    StatisticalOutlierRemoval,
    VoxelDownsampling,
)
from registration.synchronisation import synchronise

FRAMES, SWEEP_MM, MAX_GAP_S = 200, 90.0, 0.1
RIGID = Deformation(bend_mm=0.0, pressure_mm=0.0)


@dataclass(frozen=True)
class ContourStyle:
    """How the vessel's wall is drawn in the frames and sampled.

    Parameters
    ----------
    smoothing_px : float, optional
        Standard deviation by which masks are smoothed before their contour is taken, in px.
    voxel_mm : float, optional
        Voxel size to which the points are thinned in mm.
    """

    smoothing_px: float = 1.0
    voxel_mm: float = 0.4


@dataclass(frozen=True)
class Swept:
    """A sweep, and what was made of the frames that a case uses.

    Parameters
    ----------
    sweep : SimulatedSweep
        Simulated sweep and its truth.
    place : str
        Part of the sweep that is used.
    used : ndarray of int, shape (k,)
        Indices of the frames that are used.
    cloud : ContourCloud
        Contour points of these frames, in the world frame.
    lines : Centerline
        Lines of the vessel in the ct frame in mm.
    shape : SymmetricShape or None
        Symmetric shape; None for a random anatomy.
    deformed : bool, optional
        Whether tissue deforms during the sweep.
    """

    sweep: SimulatedSweep
    place: str
    used: np.ndarray
    cloud: ContourCloud
    lines: Centerline
    shape: SymmetricShape | None
    deformed: bool = False

    @cached_property
    def cloud_mm(self) -> Float64[np.ndarray, "p 3"]:
        """Contour points in their true place, in the ct frame in mm."""
        return transforms.apply(self.sweep.ct_T_world, self.cloud.points_mm)

    @cached_property
    def targets_mm(self) -> Float64[np.ndarray, "t 3"]:
        """Centerline of the model at even arc length, and its branch points, in the ct frame in mm."""
        z_mm = self.sweep.model.vertices_mm[:, 2]
        low_mm, high_mm = float(z_mm.min()), float(z_mm.max())
        roots_mm = [line.points_mm[0] for line in self.lines.lines[1:]]
        roots_mm = [root_mm for root_mm in roots_mm if low_mm <= root_mm[2] <= high_mm]
        even_mm = between(self.lines, low_mm, high_mm).even_points(MAX_TARGETS - len(roots_mm))
        return np.concatenate([even_mm, np.array(roots_mm).reshape(-1, 3)])

    @cached_property
    def covered(self) -> Bool[np.ndarray, " t"]:
        """Which targets are passed by a frame's true plane, where their material lies at the time of the sweep."""
        shown_mm = self.targets_mm
        if self.deformed:
            shown_mm = self.sweep.deformation.as_swept(shown_mm)
        return passed(self.sweep, self.used, shown_mm)

    @cached_property
    def symmetry(self) -> Symmetry:
        """Symmetry of the case: the poses that are as right as the true one."""
        if self.shape is None:
            return Symmetry()
        return self.shape.symmetry_of(self.cloud_mm, self.sweep.model.vertices_mm)


def swept(anatomy: str, seed: int, number: int, kind: Kind, rng: np.random.Generator) -> Swept:
    """Simulate a sweep and extract the points of the frames that a kind uses.

    Parameters
    ----------
    anatomy : str
        Name of a symmetric shape, or of a random anatomy.
    seed : int
        Seed of the anatomy.
    number : int
        Number of the sweep, from 0.
    kind : Kind
        Kind of case.
    rng : numpy.random.Generator
        Random stream of the choice of frames.

    Returns
    -------
    Swept
        The sweep and its points.

    Raises
    ------
    InputError
        If the anatomy has no centerline.
    """
    if anatomy not in SHAPES:
        sweep, lines = simulated(sweep_settings(RANDOM, seed), number)
        return seen(sweep, lines, kind, rng)
    shape = SHAPES[anatomy][0]()
    with tempfile.TemporaryDirectory() as folder:
        surface = Path(folder) / "surface.ply"
        write_surface(surface, surround(shape.lines))
        sweep = simulate_sweep(sweep_settings(MESH, seed, mesh=str(surface)), number, pictures=False)
    lines = Centerline(tuple(_polyline(line) for line in shape.lines))
    return replace(seen(sweep, lines, kind, rng), shape=shape)


def simulated(
    settings: PhantomSettings, number: int, displacement: Displacement | None = None
) -> tuple[SimulatedSweep, Centerline]:
    """Simulate a sweep without pictures over an anatomy that has a centerline.

    Parameters
    ----------
    settings : PhantomSettings
        Settings of the phantom.
    number : int
        Number of the sweep, from 0.
    displacement : Displacement or None, optional
        Displacement of the tissue in place of the settings' bend.

    Returns
    -------
    sweep : SimulatedSweep
        Sweep and its truth.
    lines : Centerline
        Lines of the vessel in the ct frame in mm.

    Raises
    ------
    InputError
        If the anatomy has no centerline.
    """
    if displacement is None:
        sweep = _resimulated(settings, number)
    else:
        sweep = simulate_sweep(settings, number, pictures=False, displacement=displacement)
    if sweep.centerline is None:
        raise InputError(f"anatomy: expected one with a centerline, received {settings.subset}")
    return sweep, sweep.centerline


@lru_cache(maxsize=1)
def _resimulated(settings: PhantomSettings, number: int) -> SimulatedSweep:
    """A sweep that several cases of an anatomy show parts of."""
    return simulate_sweep(settings, number, pictures=False)


def seen(
    sweep: SimulatedSweep,
    lines: Centerline,
    kind: Kind,
    rng: np.random.Generator,
    style: ContourStyle = ContourStyle(),
) -> Swept:
    """Extract the points of the frames that a kind uses.

    Parameters
    ----------
    sweep : SimulatedSweep
        Simulated sweep.
    lines : Centerline
        Lines of the vessel in the ct frame in mm.
    kind : Kind
        Kind of case.
    rng : numpy.random.Generator
        Random stream of the choice of frames.
    style : ContourStyle, optional
        How the wall is drawn.

    Returns
    -------
    Swept
        The sweep and its points.
    """
    posed = synchronise(sweep.sweep, MAX_GAP_S)
    place, chosen = kind.choose(len(posed.kept), rng)
    used = posed.kept[chosen]
    cloud = ContourExtractor(level=0.5, smoothing_px=style.smoothing_px, min_points=8)(
        sweep.masks[used], posed.world_A_pixel[chosen]
    )
    for leave_out in (
        VoxelDownsampling(style.voxel_mm),
        StatisticalOutlierRemoval(16, 4.0),
        RadiusOutlierRemoval(2.0, 4),
    ):
        cloud = leave_out(cloud).cloud
    return Swept(sweep, place, used, _numbered(cloud, used), lines, None)


def sweep_settings(
    subset: str, seed: int, *, mesh: str = "", deformation: Deformation = RIGID, frames: int = FRAMES
) -> PhantomSettings:
    """Return the settings of a benchmark's sweep.

    Parameters
    ----------
    subset : str
        Kind of vessel, as the simulator's settings name it.
    seed : int
        Seed of a random anatomy, whose sweeps differ by their number alone; of other vessels that of all else.
    mesh : str, optional
        File of the vessel's surface with ``subset`` mesh.
    deformation : Deformation, optional
        Deformation of the tissue; none if not given.
    frames : int, optional
        Number of frames.

    Returns
    -------
    PhantomSettings
        Settings of the phantom.
    """
    return PhantomSettings(
        subset=subset,
        seed=0 if subset == RANDOM else seed,
        anatomy_seed=seed,
        mesh=mesh,
        motion=Motion(frames=frames, length_mm=SWEEP_MM),
        deformation=deformation,
    )


def _numbered(cloud: ContourCloud, used: np.ndarray) -> ContourCloud:
    """The same cloud, its frames numbered as in the sweep."""
    return take(
        ContourCloud(**{**vars(cloud), "frame_index": used[cloud.frame_index]}), np.arange(len(cloud))
    )


def _polyline(line: VesselLine) -> Polyline:
    return Polyline(line.points_mm[::5], line.radius_mm[::5])


def between(lines: Centerline, low_mm: float, high_mm: float) -> Centerline:
    """Take the part of a centerline between two heights: a CT is cropped along z.

    Parameters
    ----------
    lines : Centerline
        Lines in the ct frame in mm.
    low_mm, high_mm : float
        Heights z in mm.

    Returns
    -------
    Centerline
        Lines of which at least two points lie between the heights.
    """
    kept = []
    for line in lines.lines:
        inside = (line.points_mm[:, 2] >= low_mm) & (line.points_mm[:, 2] <= high_mm)
        if inside.sum() > 1:
            kept.append(Polyline(line.points_mm[inside], line.radius_mm[inside]))
    return Centerline(tuple(kept))
