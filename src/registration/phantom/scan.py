"""A whole simulated sweep: frames, recorded poses, and the truth behind both."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Float64, UInt8
from scipy.spatial.transform import Rotation

from registration import frames
from registration.geometry import Centerline, Mesh
from registration.phantom.anatomy import Anatomy, anatomy_of
from registration.phantom.beams import Beams
from registration.phantom.bmode import BMode
from registration.phantom.ct import fixed_model
from registration.phantom.deformation import Bend, Press, SweepDeformation, View, draw_bend
from registration.phantom.settings import PhantomSettings
from registration.phantom.slicing import cut, rasterise, section
from registration.phantom.tissue import TissueModel
from registration.phantom.trajectory import Path, disturb, plan, random_rigid
from registration.phantom.transmission import Contact, draw_contact
from registration.sweep import ProbeCalibration, TrackedSweep

# Poses are recorded a little before the first and after the last frame, so that every frame lies between two.
OVERHANG_S = 0.15
# Image coordinates are lateral, depth and elevation; the probe's are x lateral, z into the body.
PROBE_T_IMAGE = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class SimulatedSweep:
    """A tracked sweep with everything that is known about it.

    ``sweep`` is what a user would have: noisy poses, late time stamps, the calibration as recorded. The truth:
    ``masks`` (n, height, width) of the vessel as each frame shows it; ``hidden`` (n, height, width), pixels behind a
    shadow or without contact; ``world_A_pixel`` (n, 4, 4) of each frame by its true pose; ``ct_T_world``; the
    undeformed ``anatomy`` and its ``centerline`` in the ct frame (None for a user's mesh); ``deformation``;
    ``contact``; ``hard_spots_mm`` (k, 3) in the ct frame that throw shadows. ``model`` is the surface re-segmented
    from the simulated CT, in the ct frame: the fixed side of a registration. ``settings`` hold the rest.
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


def simulate_sweep(settings: PhantomSettings, sweep: int) -> SimulatedSweep:
    """Simulate the sweep number ``sweep`` (0 and up) of a phantom.

    Sweeps of one phantom share its tissue, its place in the world, the probe's calibration, the bend and the CT; path,
    pressure, contact and noise differ. The same settings and number give the same bytes.
    """
    return SweepSimulator(settings, sweep).run()


@lru_cache(maxsize=8)
def model_of(settings: PhantomSettings) -> Mesh:
    """The fixed model of a phantom, re-segmented from its simulated CT, in the ct frame."""
    anatomy = anatomy_of(settings)
    return _moved(
        fixed_model(anatomy, settings.ct, np.random.default_rng([*settings.entropy, 20])), anatomy.ct_T_bed
    )


@dataclass(frozen=True)
class SweepSimulator:
    """One sweep in the making; each frame can be made on its own, in any order."""

    settings: PhantomSettings
    number: int

    @cached_property
    def anatomy(self) -> Anatomy:
        """The vessel under the probe."""
        return anatomy_of(self.settings)

    @cached_property
    def tissue(self) -> TissueModel:
        """The tissue it lies in."""
        seed = int(np.random.SeedSequence(self.settings.entropy).generate_state(1)[0])
        return TissueModel(self.anatomy, self.settings.tissue, self.settings.artefacts, seed)

    @cached_property
    def imager(self) -> BMode:
        """The scanner."""
        return BMode(self.settings.scanner, self.tissue)

    @cached_property
    def bend(self) -> Bend | None:
        """How the body lies differently than in the CT, the same in all sweeps of a phantom."""
        wanted = self.settings.deformation
        rng = np.random.default_rng([*self.settings.entropy, 13])
        return draw_bend(self.anatomy.guide_mm, wanted.bend_mm, wanted.bend_length_mm, rng)

    @cached_property
    def path(self) -> Path:
        """The probe's true path."""
        settings = self.settings
        rng = np.random.default_rng([*settings.entropy, 11, self.number])
        return plan(
            self.anatomy, settings.motion, settings.deformation.pressure_mm, settings.scanner.sag_mm, rng
        )

    @cached_property
    def contact(self) -> Contact:
        """How well the probe touches the skin."""
        rng = np.random.default_rng([*self.settings.entropy, 14, self.number])
        return draw_contact(self.settings.motion.frames, self.settings.artefacts, rng)

    @cached_property
    def frame_times_s(self) -> Float64[np.ndarray, "n"]:
        """When each frame is truly taken."""
        motion = self.settings.motion
        return (np.arange(motion.frames) + 0.5) * motion.duration_s / motion.frames

    @cached_property
    def bent_surface_mm(self) -> Float64[np.ndarray, "v 3"]:
        """Vertices of the vessel's surface where the body lies now."""
        vertices_mm = self.anatomy.surface.vertices_mm
        return self.bend(vertices_mm) if self.bend else vertices_mm

    def view(self, frame: int) -> View:
        """What one frame looks at: the true pose, the bend and the push."""
        times_s = self.frame_times_s[frame : frame + 1]
        resting = View(self.path.at(times_s)[0] @ PROBE_T_IMAGE, self.bend)
        wanted, pressure_mm = self.settings.deformation, float(self.path.pressure_mm(times_s)[0])
        if pressure_mm <= 0:
            return resting
        area_mm2, centre_mm = section(
            cut(resting.pressed(self.bent_surface_mm), self.anatomy.surface.triangles)
        )
        squeeze = self.anatomy.squeeze if wanted.squeeze is None else wanted.squeeze
        press = Press(
            depth_mm=pressure_mm,
            fade_mm=wanted.pressure_depth_mm,
            half_width_mm=self.imager.beams.half_arc_mm,
            squeeze=squeeze * pressure_mm / wanted.pressure_mm if area_mm2 > 0 else 0.0,
            centre_mm=centre_mm,
            reach_mm=1.5 * max(1.0, float(np.sqrt(max(area_mm2, 0.0) / np.pi))),
        )
        return View(resting.tissue_T_image, self.bend, press)

    def frame(
        self, frame: int, view: View
    ) -> tuple[UInt8[np.ndarray, "h w"], Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
        """Picture, mask and hidden pixels of one frame."""
        scanner, beams = self.settings.scanner, self.imager.beams
        noise = np.random.default_rng([*self.settings.entropy, 12, self.number, frame])
        picture, hidden = self.imager(view, self.contact.loss_db(frame, beams), noise)
        segments_mm = cut(view.pressed(self.bent_surface_mm), self.anatomy.surface.triangles)
        shown_mm = beams.displayed(segments_mm)
        corner_mm = np.array([axis[0, 0] for axis in beams.pixel_places_mm])
        mask = rasterise((shown_mm - corner_mm) / scanner.pixel_mm, scanner.height_px, scanner.width_px)
        return picture, mask & beams.seen, hidden

    def run(self) -> SimulatedSweep:
        """Make all frames and gather the truth."""
        settings, ct_T_bed = self.settings, self.anatomy.ct_T_bed
        ct_T_world, calibration, recorded = self._setup()
        world_T_bed = frames.invert_rigid(ct_T_world) @ ct_T_bed
        views = [self.view(frame) for frame in range(settings.motion.frames)]
        made = [self.frame(frame, view) for frame, view in enumerate(views)]
        images, masks, hidden = (np.stack(part) for part in zip(*made, strict=True))
        bed_T_probe = self.path.at(self.frame_times_s)
        centerline = self.anatomy.centerline
        return SimulatedSweep(
            sweep=self._tracked(images, world_T_bed, calibration, recorded),
            masks=masks,
            hidden=hidden,
            world_A_pixel=world_T_bed @ bed_T_probe @ calibration.probe_A_pixel,
            ct_T_world=ct_T_world,
            anatomy=_moved(self.anatomy.surface, ct_T_bed),
            centerline=centerline,
            model=model_of(settings),
            deformation=SweepDeformation(tuple(views), ct_T_bed),
            contact=self.contact,
            hard_spots_mm=frames.apply(ct_T_bed, self.tissue.hard_spots_mm),
            settings=settings,
        )

    def _setup(self) -> tuple[Float64[np.ndarray, "4 4"], ProbeCalibration, ProbeCalibration]:
        """``ct_T_world``, the true calibration and the one on record: the same in all sweeps of a phantom."""
        motion = self.settings.motion
        rng = np.random.default_rng([*self.settings.entropy, 10])
        ct_T_world = random_rigid(rng, 300.0)
        # A holder keeps the probe some 15 cm from the flange, turned about its axis.
        turned = Rotation.from_euler("zyx", rng.uniform([-180, -10, -10], [180, 10, 10]), degrees=True)
        ee_T_probe = frames.from_rotation(turned, rng.uniform([-20, -20, 130], [20, 20, 170]))
        axes = rng.standard_normal((2, 3))
        shift, axis = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        off = frames.from_rotation(
            Rotation.from_rotvec(motion.calibration_deg * axis, degrees=True), motion.calibration_mm * shift
        )
        probe_A_pixel = Beams(self.settings.scanner).probe_A_pixel
        true, recorded = (
            ProbeCalibration(ee_T_probe, probe_A_pixel),
            ProbeCalibration(ee_T_probe @ off, probe_A_pixel),
        )
        return ct_T_world, true, recorded

    def _tracked(
        self,
        images: UInt8[np.ndarray, "n h w"],
        world_T_bed: Float64[np.ndarray, "4 4"],
        calibration: ProbeCalibration,
        recorded: ProbeCalibration,
    ) -> TrackedSweep:
        """The sweep as a robot and a frame grabber would record it."""
        motion = self.settings.motion
        pose_times_s = np.arange(-OVERHANG_S, self.path.duration_s + OVERHANG_S, 1.0 / motion.pose_rate_hz)
        bed_T_probe = self.path.at(np.clip(pose_times_s, 0.0, self.path.duration_s))
        world_T_ee = world_T_bed @ bed_T_probe @ frames.invert_rigid(calibration.ee_T_probe)
        noise = np.random.default_rng([*self.settings.entropy, 15, self.number])
        return TrackedSweep(
            images=images,
            image_times_s=self.frame_times_s + motion.latency_s,
            world_T_ee=disturb(world_T_ee, motion.noise_mm, motion.noise_deg, noise),
            pose_times_s=pose_times_s,
            calibration=recorded,
        )


def _moved(mesh: Mesh, A_T_B: Float64[np.ndarray, "4 4"]) -> Mesh:
    return Mesh(frames.apply(A_T_B, mesh.vertices_mm), mesh.triangles)
