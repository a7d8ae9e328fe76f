"""What the consistency study measures: one reconstructed sweep compared with the truth, and two with each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from experiments.analysis.registration.reconstruction_faults import mask_record, numbers, surface_record
from experiments.analysis.registration.simulated_truth import surface_in_ct
from experiments.errors import InputError
from experiments.studies.consistency.report import COMMON, TRUTH
from registration.errors import InputError as RegistrationInputError
from registration.geometry.shapes import Mesh
from registration.metrics.surface_agreement import counterparts, surface_agreement
from registration.phantom.scan import SimulatedSweep
from registration.pipeline import Reconstruction
from registration.synchronisation import synchronise

DISTANCES = ("msd_mm", "hd95_mm", "msd_covered_mm", "hd95_covered_mm")
# In place of the number of a sweep, where a row has none.
NONE = -1


@dataclass(frozen=True)
class Repeat:
    """One reconstructed sweep.

    A sweep that could not be reconstructed has its row alone.

    Parameters
    ----------
    row : dict
        Row of the sweep in the table.
    offset_mm : ndarray, shape (n,)
        How far the sweep lies outside the truth in mm at each of many places of the truth, NaN where it has
        no counterpart.
    seen : Mesh or None, optional
        Surface as tracked, in the ct frame in mm; None for a failed sweep.
    material : Mesh or None, optional
        Surface with the known deformation taken out, in the ct frame in mm; None for a failed sweep.
    """

    row: dict[str, Any]
    offset_mm: np.ndarray
    seen: Mesh | None = None
    material: Mesh | None = None


def tried(
    truth: SimulatedSweep,
    chain: Reconstruction,
    masks: np.ndarray,
    max_gap_s: float,
    drawn: tuple[int, int],
) -> Repeat:
    """Reconstruct one simulated sweep and compare it with the truth.

    Parameters
    ----------
    truth : SimulatedSweep
        Simulated sweep and its truth.
    chain : Reconstruction
        Reconstruction.
    masks : ndarray, shape (n, height, width)
        Masks or probabilities of its frames.
    max_gap_s : float
        A frame in a longer gap in s between two poses is dropped.
    drawn : tuple[int, int]
        Number of places on each surface where distances are measured, and the seed that draws them.

    Returns
    -------
    Repeat
        Reconstructed sweep; one that cannot be reconstructed has infinite distances and the reason.
    """
    try:
        return _repeat(truth, chain, masks, max_gap_s, drawn)
    except (InputError, RegistrationInputError) as refusal:
        row = {"kind": TRUTH, "second": NONE, **dict.fromkeys(DISTANCES, np.inf), "error": str(refusal)}
        return Repeat(row, np.full(drawn[0], np.nan))


def _repeat(
    truth: SimulatedSweep,
    chain: Reconstruction,
    masks: np.ndarray,
    max_gap_s: float,
    drawn: tuple[int, int],
) -> Repeat:
    posed = synchronise(truth.sweep, max_gap_s)
    found = chain(posed.select(masks), posed.world_A_pixel)
    seen, material = surface_in_ct(truth, found.surface)
    samples, seed = drawn
    offset_mm = _offset_mm(material, truth.anatomy, samples, seed)
    row = {
        "kind": TRUTH,
        "second": NONE,
        **asdict(surface_agreement(material, truth.anatomy, samples=samples, seed=seed)),
        "bias_mm": float(np.nanmean(offset_mm)),
        "frames": len(posed.kept),
        "points": len(found.cloud),
        "frames_dropped": sum(posed.dropped.values()),
        **numbers(mask_record(found, posed.kept), surface_record(found, posed.kept)),
        "runtime_s": sum(found.seconds.values()),
        "error": "",
    }
    return Repeat(row, offset_mm, seen, material)


def _offset_mm(found: Mesh, truth: Mesh, samples: int, seed: int) -> np.ndarray:
    """How far ``found`` lies outside the truth, along its normal, at places of the truth that all sweeps share."""
    rng = np.random.default_rng([seed, 2])
    corners_mm = truth.corners_mm[
        rng.choice(len(truth.triangles), samples, p=truth.areas_mm2 / truth.areas_mm2.sum())
    ]
    outwards = np.cross(corners_mm[:, 1] - corners_mm[:, 0], corners_mm[:, 2] - corners_mm[:, 0])
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    places_mm = corners_mm.mean(axis=1)
    there = counterparts(places_mm, found)
    along_mm = np.einsum("pi,pi->p", there.points_mm - places_mm, outwards)
    return np.where(there.covered, along_mm, np.nan)


def common(offsets_mm: Sequence[np.ndarray]) -> dict[str, Any]:
    """Compute the error that all sweeps share.

    Parameters
    ----------
    offsets_mm : sequence of ndarray
        Signed distances in mm to the truth at the same places for every sweep, NaN where it shows nothing.

    Returns
    -------
    dict
        Row of the table: the mean over the sweeps, at each place that all sweeps show.

    Raises
    ------
    InputError
        If no part of the vessel is shown by all sweeps.
    """
    stacked_mm = np.stack(offsets_mm)
    shown = np.isfinite(stacked_mm).all(axis=0)
    if not shown.any():
        raise InputError("sweeps: expected a part of the vessel that all sweeps show, received none")
    mean_mm = stacked_mm[:, shown].mean(axis=0)
    return {
        "kind": COMMON,
        "first": NONE,
        "second": NONE,
        "msd_covered_mm": float(np.abs(mean_mm).mean()),
        "hd95_covered_mm": float(np.percentile(np.abs(mean_mm), 95)),
        "bias_mm": float(mean_mm.mean()),
        "covered_second": float(shown.mean()),
        "error": "",
    }


def pair(first: Repeat, second: Repeat, drawn: tuple[int, int]) -> dict[str, Any]:
    """Compare two sweeps.

    Parameters
    ----------
    first, second : Repeat
        Reconstructed sweep.
    drawn : tuple[int, int]
        Number of places on each surface where distances are measured, and the seed that draws them.

    Returns
    -------
    dict
        Distances in mm; infinite where one sweep failed or the two show no common part.
    """
    failed = dict.fromkeys((*DISTANCES, "msd_tissue_mm", "hd95_tissue_mm"), np.inf)
    if first.seen is None or second.seen is None or first.material is None or second.material is None:
        return failed | {"error": first.row["error"] or second.row["error"]}
    samples, seed = drawn
    try:
        seen = surface_agreement(first.seen, second.seen, samples=samples, seed=seed)
        material = surface_agreement(first.material, second.material, samples=samples, seed=seed)
    except RegistrationInputError as refusal:
        return failed | {"error": str(refusal)}
    tissue = {"msd_tissue_mm": material.msd_covered_mm, "hd95_tissue_mm": material.hd95_covered_mm}
    return asdict(seen) | tissue | {"error": ""}
