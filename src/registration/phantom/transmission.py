"""What is lost on the way: attenuation summed along the beams, and beams that lose contact with the skin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64
from scipy.ndimage import gaussian_filter1d, zoom

from registration.phantom.acoustics import Artefacts, Tissue
from registration.phantom.beams import Beams

# Attenuation is summed on a coarser grid: (samples, beams) a cell.
COARSE = (8, 6)
CONTACT_LOSS_DB = 30.0


def along_beams_db(
    beams: Beams,
    tissue: Tissue,
    places: tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " n"]],
    attenuation: Float32[np.ndarray, " n"],
    weight: Float32[np.ndarray, " n"],
) -> Float32[np.ndarray, "s b"]:
    """Sum the attenuation along the beams.

    Behind a vessel more gets through than is compensated: its posterior enhancement.

    Parameters
    ----------
    beams : Beams
        Grid of beams.
    tissue : Tissue
        Acoustic properties.
    places : tuple of ndarray of int, shape (n,)
        Sample and beam index of each scatterer.
    attenuation : ndarray of float32, shape (n,)
        Attenuation of the tissue at each scatterer, relative to average tissue.
    weight : ndarray of float32, shape (n,)
        Share of each scatterer in the slice.

    Returns
    -------
    ndarray of float32, shape (s, b)
        Two-way loss in dB at each sample of each beam, less what the depth gain compensates.
    """
    samples, lines = beams.shape
    rows, columns = -(-samples // COARSE[0]), -(-lines // COARSE[1])
    cell = (places[0] // COARSE[0]) * columns + places[1] // COARSE[1]
    weights = np.bincount(cell, weight, minlength=rows * columns).reshape(rows, columns)
    total = np.bincount(cell, attenuation * weight, minlength=rows * columns).reshape(rows, columns)
    relative = np.where(weights > 0, total / np.maximum(weights, 1e-9), 1.0)
    rate = 2.0 * beams.scanner.frequency_mhz * COARSE[0] * beams.sample_mm / 10.0
    excess_db = rate * (tissue.attenuation_db_cm_mhz * relative - tissue.compensation_db_cm_mhz)
    excess_db[: int(beams.margin_mm / beams.sample_mm) // COARSE[0]] = 0.0
    # What lies in front of a cell, not in it: a hard spot is bright itself and dark behind.
    in_front_db = np.cumsum(excess_db, axis=0) - excess_db
    summed = gaussian_filter1d(in_front_db, 0.7, axis=1)
    fine = zoom(summed, COARSE, order=1, mode="nearest", grid_mode=True)
    return np.asarray(fine[:samples, :lines], dtype=np.float32)


@dataclass(frozen=True)
class Contact:
    """Coupling of each beam of each frame to the skin.

    Parameters
    ----------
    lost_mm : ndarray, shape (n, 2)
        Width in mm at the left and the right end of the face that has no contact, for each frame.
    """

    lost_mm: Float64[np.ndarray, "n 2"]

    def loss_db(self, frame: int, beams: Beams) -> Float32[np.ndarray, " b"]:
        """Compute the two-way loss of each beam by missing contact, with soft edges of about a millimetre.

        Parameters
        ----------
        frame : int
            Index of the frame.
        beams : Beams
            Grid of beams.

        Returns
        -------
        ndarray of float32, shape (b,)
            Loss in dB.
        """
        arc_mm, half_mm = beams.beam_arc_mm, beams.half_arc_mm
        left, right = self.lost_mm[frame]
        beyond_mm = np.maximum(left - half_mm - arc_mm, arc_mm - half_mm + right)
        open_ends = np.where((left > 0) | (right > 0), 1.0 / (1.0 + np.exp(-beyond_mm / 0.8)), 0.0)
        return np.asarray(CONTACT_LOSS_DB * open_ends, dtype=np.float32)


def draw_contact(frames: int, artefacts: Artefacts, rng: np.random.Generator) -> Contact:
    """Draw the contact over a sweep: each end is lost for stretches of it, as the body curves away.

    Parameters
    ----------
    frames : int
        Number of frames.
    artefacts : Artefacts
        Artefacts, of which ``contact_loss_mm`` counts.
    rng : numpy.random.Generator
        Random stream of the contact.

    Returns
    -------
    Contact
        Contact in each frame.
    """
    if artefacts.contact_loss_mm == 0:
        return Contact(np.zeros((frames, 2)))
    times = np.linspace(0.0, 1.0, frames)
    knots = rng.standard_normal((6, 2))
    course = np.stack([np.interp(times, np.linspace(0, 1, 6), knots[:, side]) for side in range(2)], axis=1)
    return Contact(artefacts.contact_loss_mm * np.maximum(course - 0.4, 0.0))


def ring_down(
    beams: Beams, artefacts: Artefacts, loss_db: Float[np.ndarray, " b"]
) -> Float32[np.ndarray, "s b"]:
    """Simulate the echoes between face and air in beams without contact.

    They are bands at equal distances that fade with depth.

    Parameters
    ----------
    beams : Beams
        Grid of beams.
    artefacts : Artefacts
        Artefacts, of which ``reverberation_mm`` counts.
    loss_db : ndarray, shape (b,)
        Loss of each beam by missing contact in dB.

    Returns
    -------
    ndarray of float32, shape (s, b)
        Amplitude at each sample of each beam.
    """
    depth_mm = beams.sample_depth_mm
    lost = (loss_db / CONTACT_LOSS_DB).astype(np.float32)
    bands = np.cos(np.pi * depth_mm / artefacts.reverberation_mm) ** 16 * np.exp(-depth_mm / 3.5)
    bands[depth_mm < 0] = 0.0
    return np.asarray(3.0 * bands.astype(np.float32)[:, None] * lost[None], dtype=np.float32)
