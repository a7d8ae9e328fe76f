"""Simulation of one sweep: what each frame looks at, and the frame itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float64, UInt8

from registration.phantom.anatomy import Anatomy, anatomy_of
from registration.phantom.bmode import BMode
from registration.phantom.deformation import Displacement, Press, View, draw_bend
from registration.phantom.settings import PhantomSettings
from registration.phantom.slicing import cut, rasterise, section
from registration.phantom.tissue import TissueModel
from registration.phantom.trajectory import Path, plan
from registration.phantom.transmission import Contact, draw_contact

# Image coordinates are lateral, depth and elevation; the probe's are x lateral, z into the body.
PROBE_T_IMAGE = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class SweepSimulator:
    """Simulator of one sweep; each frame can be made on its own, in any order.

    Parameters
    ----------
    settings : PhantomSettings
        Settings of the phantom.
    number : int
        Number of the sweep, from 0.
    displacement : Displacement or None, optional
        Displacement of the tissue against the CT in place of the bend that the settings ask for; None for that bend.
    """

    settings: PhantomSettings
    number: int
    displacement: Displacement | None = field(default=None, kw_only=True)

    @cached_property
    def anatomy(self) -> Anatomy:
        """Vessel under the probe."""
        return anatomy_of(self.settings)

    @cached_property
    def tissue(self) -> TissueModel:
        """Tissue that the vessel lies in."""
        seed = int(np.random.SeedSequence(self.settings.entropy).generate_state(1)[0])
        return TissueModel(self.anatomy, self.settings.tissue, self.settings.artefacts, seed)

    @cached_property
    def imager(self) -> BMode:
        """Simulator of the images."""
        return BMode(self.settings.scanner, self.tissue)

    @cached_property
    def bend(self) -> Displacement | None:
        """Displacement of the tissue against the CT, by the settings the same in all sweeps; None for none."""
        if self.displacement is not None:
            return self.displacement
        wanted = self.settings.deformation
        rng = np.random.default_rng([*self.settings.entropy, 13])
        return draw_bend(self.anatomy.guide_mm, wanted.bend_mm, wanted.bend_length_mm, rng)

    @cached_property
    def path(self) -> Path:
        """True path of the probe."""
        settings = self.settings
        rng = np.random.default_rng([*settings.entropy, 11, self.number])
        return plan(
            self.anatomy, settings.motion, settings.deformation.pressure_mm, settings.scanner.sag_mm, rng
        )

    @cached_property
    def contact(self) -> Contact:
        """Coupling of the probe to the skin."""
        rng = np.random.default_rng([*self.settings.entropy, 14, self.number])
        return draw_contact(self.settings.motion.frames, self.settings.artefacts, rng)

    @cached_property
    def frame_times_s(self) -> Float64[np.ndarray, " n"]:
        """True time of each frame in s."""
        motion = self.settings.motion
        return (np.arange(motion.frames) + 0.5) * motion.duration_s / motion.frames

    @cached_property
    def bent_surface_mm(self) -> Float64[np.ndarray, "v 3"]:
        """Vertices of the vessel's surface in mm after the bend, in the bed frame."""
        vertices_mm = self.anatomy.surface.vertices_mm
        return self.bend(vertices_mm) if self.bend else vertices_mm

    def view(self, frame: int) -> View:
        """Compute what one frame looks at: the true pose, the bend and the push.

        Parameters
        ----------
        frame : int
            Index of the frame.

        Returns
        -------
        View
            Pose and deformation of the frame.
        """
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
        """Make one frame.

        Parameters
        ----------
        frame : int
            Index of the frame.
        view : View
            Pose and deformation of the frame.

        Returns
        -------
        image : ndarray of uint8, shape (h, w)
            Grey levels.
        mask : ndarray of bool, shape (h, w)
            True mask of the vessel.
        hidden : ndarray of bool, shape (h, w)
            Pixels that an acoustic shadow or missing contact hides.
        """
        noise = np.random.default_rng([*self.settings.entropy, 12, self.number, frame])
        picture, hidden = self.imager(view, self.contact.loss_db(frame, self.imager.beams), noise)
        return picture, self.mask(view), hidden

    def mask(self, view: View) -> Bool[np.ndarray, "h w"]:
        """Compute the true mask of one frame without the image, which takes far longer.

        Parameters
        ----------
        view : View
            Pose and deformation of the frame.

        Returns
        -------
        ndarray of bool, shape (h, w)
            True mask of the vessel.
        """
        scanner, beams = self.settings.scanner, self.imager.beams
        segments_mm = cut(view.pressed(self.bent_surface_mm), self.anatomy.surface.triangles)
        shown_mm = beams.displayed(segments_mm)
        corner_mm = np.array([axis[0, 0] for axis in beams.pixel_places_mm])
        mask = rasterise((shown_mm - corner_mm) / scanner.pixel_mm, scanner.height_px, scanner.width_px)
        return mask & beams.seen
