"""A whole simulated sweep: frames, recorded poses, and the truth behind both."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float64, UInt8
from scipy.spatial.transform import Rotation

from registration import frames
from registration.geometry import Centerline, Mesh
from registration.phantom import anatomy as anatomies
from registration.phantom.anatomy import Anatomy
from registration.phantom.beams import Beams
from registration.phantom.bmode import BMode
from registration.phantom.ct import fixed_model
from registration.phantom.settings import PhantomSettings
from registration.phantom.slicing import mask_of_plane
from registration.phantom.tissue import TissueModel
from registration.phantom.trajectory import Path, disturb, plan, random_rigid
from registration.sweep import ProbeCalibration, TrackedSweep

# Poses are recorded a little before the first and after the last frame, so that every frame lies between two.
OVERHANG_S = 0.15
# Image coordinates are lateral, depth and elevation; the probe's are x lateral, z into the body.
PROBE_T_IMAGE = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class SimulatedSweep:
    """A tracked sweep with everything that is known about it.

    ``sweep`` is what a user would have: noisy poses, late time stamps. The truth: ``masks`` (n, height, width) of the
    vessel in each frame, ``world_A_pixel`` (n, 4, 4) of each frame, ``ct_T_world``, the ``anatomy``'s surface and
    ``centerline`` in the ct frame. ``model`` is the surface re-segmented from the simulated CT, in the ct frame: the
    fixed side of a registration.
    """

    sweep: TrackedSweep
    masks: Bool[np.ndarray, "n height width"]
    world_A_pixel: Float64[np.ndarray, "n 4 4"]
    ct_T_world: Float64[np.ndarray, "4 4"]
    anatomy: Mesh
    centerline: Centerline
    model: Mesh


@dataclass(frozen=True)
class _Setup:
    ct_T_world: Float64[np.ndarray, "4 4"]
    calibration: ProbeCalibration
    path: Path
    noise: np.random.Generator


def simulate_sweep(settings: PhantomSettings, sweep: int) -> SimulatedSweep:
    """Simulate the sweep number ``sweep`` (0 and up) of a phantom.

    Sweeps of one phantom share its tissue, its place in the world, the probe's calibration and the CT; path, poses and
    noise differ. The same settings and number give the same bytes.
    """
    vessel = anatomies.design(settings.subset)
    setup = _setup(settings, vessel, sweep)
    ct_T_world, calibration, path, noise = setup.ct_T_world, setup.calibration, setup.path, setup.noise
    motion = settings.motion
    true_times_s = (np.arange(motion.frames) + 0.5) / motion.frame_rate_hz
    pose_times_s = np.arange(-OVERHANG_S, path.duration_s + OVERHANG_S, 1.0 / motion.pose_rate_hz)
    ct_T_probe = path.at(true_times_s)
    probe_T_ee = frames.invert_rigid(calibration.ee_T_probe)
    world_T_ct = frames.invert_rigid(ct_T_world)
    true_world_T_ee = world_T_ct @ path.at(np.clip(pose_times_s, 0.0, path.duration_s)) @ probe_T_ee
    images, masks = _frames(settings, vessel, ct_T_probe, calibration, noise)
    tracked = TrackedSweep(
        images=images,
        image_times_s=true_times_s + motion.latency_s,
        world_T_ee=disturb(true_world_T_ee, motion, noise),
        pose_times_s=pose_times_s,
        calibration=calibration,
    )
    return SimulatedSweep(
        sweep=tracked,
        masks=masks,
        world_A_pixel=world_T_ct @ ct_T_probe @ calibration.probe_A_pixel,
        ct_T_world=ct_T_world,
        anatomy=vessel.surface,
        centerline=vessel.centerline,
        model=model_of(settings),
    )


@lru_cache(maxsize=8)
def model_of(settings: PhantomSettings) -> Mesh:
    """The fixed model of a phantom, re-segmented from its simulated CT, in the ct frame."""
    rng = np.random.default_rng([settings.seed, 20])
    return fixed_model(anatomies.design(settings.subset), settings.ct, rng)


def _setup(settings: PhantomSettings, vessel: Anatomy, sweep: int) -> _Setup:
    """What is drawn once a phantom (its place, the calibration) and once a sweep (the path, the noise)."""
    fixed = np.random.default_rng([settings.seed, 10])
    ct_T_world = random_rigid(fixed, 300.0)
    # A holder keeps the probe some 15 cm from the flange, turned about its axis.
    turned = Rotation.from_euler("zyx", fixed.uniform([-180, -10, -10], [180, 10, 10]), degrees=True)
    ee_T_probe = frames.from_rotation(turned, fixed.uniform([-20, -20, 130], [20, 20, 170]))
    calibration = ProbeCalibration(ee_T_probe, Beams(settings.scanner).probe_A_pixel)
    own = np.random.default_rng([settings.seed, 11, sweep])
    return _Setup(ct_T_world, calibration, plan(vessel, settings.motion, own), own)


def _frames(
    settings: PhantomSettings,
    vessel: Anatomy,
    ct_T_probe: Float64[np.ndarray, "n 4 4"],
    calibration: ProbeCalibration,
    noise: np.random.Generator,
) -> tuple[UInt8[np.ndarray, "n height width"], Bool[np.ndarray, "n height width"]]:
    """Picture and mask of the vessel for each true pose of the probe in the tissue."""
    scanner = settings.scanner
    imager = BMode(scanner, TissueModel(vessel, settings.tissue, settings.seed))
    images = np.empty((len(ct_T_probe), scanner.height_px, scanner.width_px), dtype=np.uint8)
    masks = np.empty(images.shape, dtype=bool)
    pixel_A_ct = frames.invert_affine(ct_T_probe @ calibration.probe_A_pixel)
    for index, image_T in enumerate(ct_T_probe @ PROBE_T_IMAGE):
        images[index] = imager(image_T, noise)
        cut = mask_of_plane(vessel.surface, pixel_A_ct[index], scanner.height_px, scanner.width_px)
        masks[index] = cut & imager.beams.seen
    return images, masks
