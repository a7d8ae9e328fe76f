"""A whole simulated sweep: frames, recorded poses, and the truth behind both."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float64, UInt8
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.brief import brief_repr
from registration.checks import require_count
from registration.geometry.shapes import Centerline, Mesh
from registration.phantom.anatomy import anatomy_of
from registration.phantom.beams import Beams
from registration.phantom.ct import fixed_model
from registration.phantom.deformation import SweepDeformation
from registration.phantom.displacement import Displacement
from registration.phantom.settings import PhantomSettings
from registration.phantom.simulator import SweepSimulator
from registration.phantom.trajectory import disturb, random_rigid
from registration.phantom.transmission import Contact
from registration.sweep import ProbeCalibration, TrackedSweep

# Poses are recorded a little before the first and after the last frame, so that every frame lies between two.
OVERHANG_S = 0.15


@dataclass(frozen=True)
class SimulatedSweep:
    """Tracked sweep with everything that is known about it.

    Parameters
    ----------
    sweep : TrackedSweep
        What a user would have: noisy poses, late time stamps, the calibration as recorded.
    masks : ndarray of bool, shape (n, height, width)
        True mask of the vessel as each frame shows it.
    hidden : ndarray of bool, shape (n, height, width)
        Pixels behind an acoustic shadow or without contact.
    world_A_pixel : ndarray, shape (n, 4, 4)
        Affine matrix of each frame by its true pose, from pixels to the world frame in mm.
    ct_T_world : ndarray, shape (4, 4)
        True rigid transform from the world to the ct frame.
    anatomy : Mesh
        Undeformed surface in the ct frame in mm.
    centerline : Centerline or None
        Centerline in the ct frame in mm; None for a user's mesh.
    model : Mesh
        Surface re-segmented from the simulated CT, in the ct frame: the fixed side of a registration.
    deformation : SweepDeformation
        True deformation of the tissue.
    contact : Contact
        Coupling of the probe to the skin.
    hard_spots_mm : ndarray, shape (k, 3)
        Centres in the ct frame in mm of the spots that cast shadows.
    settings : PhantomSettings
        Settings of the phantom.
    """

    sweep: TrackedSweep
    masks: Bool[np.ndarray, "n height width"]
    hidden: Bool[np.ndarray, "n height width"]
    world_A_pixel: Float64[np.ndarray, "n 4 4"]
    ct_T_world: Float64[np.ndarray, "4 4"]
    anatomy: Mesh
    centerline: Centerline | None
    model: Mesh
    deformation: SweepDeformation
    contact: Contact
    hard_spots_mm: Float64[np.ndarray, "k 3"]
    settings: PhantomSettings

    __repr__ = brief_repr


def simulate_sweep(
    settings: PhantomSettings, sweep: int, pictures: bool = True, displacement: Displacement | None = None
) -> SimulatedSweep:
    """Simulate one sweep over a phantom.

    Sweeps of one phantom share its tissue, its place in the world, the probe's calibration, the bend and the
    CT; path, pressure, contact and noise differ. The same settings and number give the same bytes.

    Parameters
    ----------
    settings : PhantomSettings
        Settings of the phantom.
    sweep : int
        Number of the sweep, from 0.
    pictures : bool, optional
        False leaves all images black and nothing hidden; masks, poses and truth are the same, within a
        hundredth of the time.
    displacement : Displacement or None, optional
        Displacement of the tissue against the CT, in the bed frame, in place of the bend of the settings.

    Returns
    -------
    SimulatedSweep
        The sweep and its truth.

    Raises
    ------
    InputError
        If the number is negative or the settings lead to no anatomy or model.
    """
    require_count("sweep", sweep, 0)
    maker = SweepSimulator(settings, sweep, displacement=displacement)
    ct_T_bed = maker.anatomy.ct_T_bed
    ct_T_world, calibration, recorded = _setup(settings)
    world_T_bed = transforms.invert_rigid(ct_T_world) @ ct_T_bed
    views = tuple(maker.view(frame) for frame in range(settings.motion.frames))
    if pictures:
        made = [maker.frame(frame, view) for frame, view in enumerate(views)]
        images, masks, hidden = (np.stack(part) for part in zip(*made, strict=True))
    else:
        masks = np.stack([maker.mask(view) for view in views])
        images, hidden = np.zeros(masks.shape, dtype=np.uint8), np.zeros(masks.shape, dtype=bool)
    bed_T_probe = maker.path.at(maker.frame_times_s)
    return SimulatedSweep(
        sweep=_tracked(maker, images, world_T_bed, (calibration, recorded)),
        masks=masks,
        hidden=hidden,
        world_A_pixel=world_T_bed @ bed_T_probe @ calibration.probe_A_pixel,
        ct_T_world=ct_T_world,
        anatomy=_moved(maker.anatomy.surface, ct_T_bed),
        centerline=maker.anatomy.centerline,
        model=model_of(settings),
        deformation=SweepDeformation(views, ct_T_bed),
        contact=maker.contact,
        hard_spots_mm=transforms.apply(ct_T_bed, maker.tissue.hard_spots_mm),
        settings=settings,
    )


@lru_cache(maxsize=8)
def model_of(settings: PhantomSettings) -> Mesh:
    """Make the fixed model of a phantom, re-segmented from its simulated CT.

    Parameters
    ----------
    settings : PhantomSettings
        Settings of the phantom.

    Returns
    -------
    Mesh
        Surface in the ct frame in mm.
    """
    anatomy = anatomy_of(settings)
    return _moved(
        fixed_model(anatomy, settings.ct, np.random.default_rng([*settings.entropy, 20])), anatomy.ct_T_bed
    )


def _setup(
    settings: PhantomSettings,
) -> tuple[Float64[np.ndarray, "4 4"], ProbeCalibration, ProbeCalibration]:
    """``ct_T_world``, the true calibration and the one on record: the same in all sweeps of a phantom."""
    motion = settings.motion
    rng = np.random.default_rng([*settings.entropy, 10])
    ct_T_world = random_rigid(rng, 300.0)
    # A holder keeps the probe some 15 cm from the flange, turned about its axis.
    turned = Rotation.from_euler("zyx", rng.uniform([-180, -10, -10], [180, 10, 10]), degrees=True)
    ee_T_probe = transforms.from_rotation(turned, rng.uniform([-20, -20, 130], [20, 20, 170]))
    axes = rng.standard_normal((2, 3))
    shift, axis = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    off = transforms.from_rotation(
        Rotation.from_rotvec(motion.calibration_deg * axis, degrees=True), motion.calibration_mm * shift
    )
    probe_A_pixel = Beams(settings.scanner).probe_A_pixel
    true, recorded = (
        ProbeCalibration(ee_T_probe, probe_A_pixel),
        ProbeCalibration(ee_T_probe @ off, probe_A_pixel),
    )
    return ct_T_world, true, recorded


def _tracked(
    maker: SweepSimulator,
    images: UInt8[np.ndarray, "n h w"],
    world_T_bed: Float64[np.ndarray, "4 4"],
    calibrations: tuple[ProbeCalibration, ProbeCalibration],
) -> TrackedSweep:
    """The sweep as a robot and a frame grabber would record it, with the true calibration and the one on record."""
    motion = maker.settings.motion
    pose_times_s = np.arange(-OVERHANG_S, maker.path.duration_s + OVERHANG_S, 1.0 / motion.pose_rate_hz)
    bed_T_probe = maker.path.at(np.clip(pose_times_s, 0.0, maker.path.duration_s))
    world_T_ee = world_T_bed @ bed_T_probe @ transforms.invert_rigid(calibrations[0].ee_T_probe)
    noise = np.random.default_rng([*maker.settings.entropy, 15, maker.number])
    return TrackedSweep(
        images=images,
        image_times_s=maker.frame_times_s + motion.latency_s,
        world_T_ee=disturb(world_T_ee, motion.noise_mm, motion.noise_deg, noise),
        pose_times_s=pose_times_s,
        calibration=calibrations[1],
    )


def _moved(mesh: Mesh, A_T_B: Float64[np.ndarray, "4 4"]) -> Mesh:
    return Mesh(transforms.apply(A_T_B, mesh.vertices_mm), mesh.triangles)
