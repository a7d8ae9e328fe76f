"""What a reconstruction left out, and why: masks that disagree, pieces of no vessel, gaps between frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.reporting.labels import counted
from registration.reconstruction.mask_outliers import POSITION, REASONS, SHAPE, SIZE

if TYPE_CHECKING:
    from registration.pipeline import Gathered, Reconstructed

# So many frames are named in a sentence; all are in the record and in the table.
NAMED = 8
IN_WORDS = {
    POSITION: "lie next to their neighbours",
    SIZE: "are larger or smaller",
    SHAPE: "have another shape",
}


def mask_record(found: Gathered, frame: np.ndarray) -> dict[str, Any]:
    """Record which masks were rejected and why.

    Parameters
    ----------
    found : Gathered
        Masks and contours of a sweep.
    frame : ndarray of int, shape (k,)
        Number of each mask's frame in the recording.

    Returns
    -------
    dict
        Content for JSON: rejected frames with reasons, counts by reason, frames with specks, empty frames,
        undecided share.
    """
    checked = found.checked
    return {
        "rejected": [
            {"frame": int(frame[place]), "reason": reason, "times_limit": float(checked.excess[place])}
            for place, reason in enumerate(checked.reason)
            if reason
        ],
        "rejected_by_reason": {reason: checked.reason.count(reason) for reason in REASONS},
        "with_specks_removed": [int(frame[place]) for place in np.flatnonzero(checked.specks)],
        "empty_between_others": [int(frame[place]) for place in np.flatnonzero(checked.empty)],
        "undecided_share": checked.undecided,
    }


def surface_record(found: Reconstructed, frame: np.ndarray) -> dict[str, Any]:
    """Record the pieces of the surface, what was left out, and the gaps between frames that stayed open.

    Parameters
    ----------
    found : Reconstructed
        Reconstruction of a sweep.
    frame : ndarray of int, shape (k,)
        Number of each mask's frame in the recording.

    Returns
    -------
    dict
        Content for JSON; lengths in mm, shares from 0 to 1.
    """
    shown, steps_mm = steps_along(found)
    wide = np.flatnonzero(steps_mm > found.gap_mm)
    swept_mm = float(steps_mm.sum())
    return {
        "pieces": found.pieces.kept,
        "pieces_left_out": found.pieces.dropped,
        "area_share_left_out": found.pieces.share_dropped,
        "swept_mm": swept_mm,
        "gap_share": float(steps_mm[wide].sum() / swept_mm) if swept_mm > 0 else 0.0,
        "gaps": [
            {
                "after_frame": int(frame[shown[place]]),
                "before_frame": int(frame[shown[place + 1]]),
                "gap_mm": float(steps_mm[place]),
            }
            for place in wide
        ],
    }


def numbers(masks: dict[str, Any], surface: dict[str, Any] | None) -> dict[str, float]:
    """Convert the records into scalars for the tracker.

    Parameters
    ----------
    masks : dict
        As ``mask_record`` gives it.
    surface : dict or None
        As ``surface_record`` gives it; None if there is no surface, whose numbers are then NaN.

    Returns
    -------
    dict
        Scalars by the name of the metric.
    """
    found = {
        "frames_rejected": float(len(masks["rejected"])),
        **{f"rejected_{reason}": float(count) for reason, count in masks["rejected_by_reason"].items()},
        "frames_with_specks": float(len(masks["with_specks_removed"])),
        "frames_empty_between": float(len(masks["empty_between_others"])),
    }
    for name in ("pieces", "pieces_left_out", "area_share_left_out", "gap_share"):
        found[name] = float(surface[name]) if surface is not None else float("nan")
    return found


def sentences(masks: dict[str, Any], surface: dict[str, Any] | None) -> tuple[str, ...]:
    """Describe what was left out, for the user.

    Parameters
    ----------
    masks : dict
        As ``mask_record`` gives it.
    surface : dict or None
        As ``surface_record`` gives it; None if there is no surface.

    Returns
    -------
    tuple of str
        Sentences; none if nothing was left out.
    """
    return (*_of_masks(masks), *(() if surface is None else _of_surface(surface)))


def _of_masks(masks: dict[str, Any]) -> list[str]:
    said = []
    if masks["rejected"]:
        reasons = ", ".join(
            f"{count} {IN_WORDS[reason]}" for reason, count in masks["rejected_by_reason"].items() if count
        )
        named = _listed([entry["frame"] for entry in masks["rejected"]])
        said.append(
            f"{len(masks['rejected'])} masks disagree with those before and after them and were left out: {reasons} "
            f"(frames {named}, from 0)."
        )
    if masks["with_specks_removed"]:
        several = counted(len(masks["with_specks_removed"]), "mask")
        said.append(
            f"In {several} a part far from the vessel of the neighbours was left out "
            f"(frames {_listed(masks['with_specks_removed'])}, from 0)."
        )
    if masks["empty_between_others"]:
        said.append(
            f"{len(masks['empty_between_others'])} masks between others that show the vessel show none "
            f"(frames {_listed(masks['empty_between_others'])}, from 0)."
        )
    if masks["undecided_share"] > 0:
        said.append(
            f"{masks['undecided_share']:.0%} of the masks disagree with those before and after them: too many to tell "
            "right from wrong, so none was left out, and the surface is not to be relied on."
        )
    return said


def _of_surface(surface: dict[str, Any]) -> list[str]:
    said = []
    if surface["gaps"]:
        widest = max(gap["gap_mm"] for gap in surface["gaps"])
        said.append(
            f"{len(surface['gaps'])} gaps between frames, up to {widest:.1f} mm wide, are {surface['gap_share']:.1%} "
            f"of the way: the surface is open there and has {surface['pieces']} pieces."
        )
    elif surface["pieces"] > 1:
        said.append(f"The surface has {surface['pieces']} pieces.")
    if surface["pieces_left_out"]:
        said.append(
            f"{surface['pieces_left_out']} pieces that do not continue the vessel, "
            f"{surface['area_share_left_out']:.1%} of the reconstructed area, were left out."
        )
    return said


def steps_along(found: Gathered) -> tuple[np.ndarray, np.ndarray]:
    """Measure the steps from each contour to the next along the image's normal.

    The in-plane path of the vessel counts as no gap.

    Parameters
    ----------
    found : Gathered
        Masks and contours of a sweep.

    Returns
    -------
    shown : ndarray of int, shape (s,)
        Indices of the masks that have contours, ascending.
    steps_mm : ndarray, shape (s - 1,)
        Distance in mm from each of them to the next.
    """
    contours = found.contours
    shown = np.unique(contours.frame_index)
    middle_mm = np.stack([contours.points_mm[contours.frame_index == frame].mean(axis=0) for frame in shown])
    axes = contours.world_A_pixel[shown, :3, :2]
    facing = np.cross(axes[..., 0], axes[..., 1])
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    return shown, np.abs(np.einsum("fi,fi->f", np.diff(middle_mm, axis=0), facing[1:]))


def _listed(values: Sequence[int]) -> str:
    named = ", ".join(str(value) for value in values[:NAMED])
    return named if len(values) <= NAMED else f"{named} and {len(values) - NAMED} more"
