"""What a segmentation found: a row a mask, the whole as JSON, and in sentences."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, UInt8
from scipy.ndimage import binary_erosion

from experiments.studies.segment.sources import NamedFrame
from models.model_file import SegmentationModel
from models.predictor import Frame, FramePrediction, StageTimes

OUTLINE = (255, 210, 0)
STAGES = tuple(field.name for field in dataclasses.fields(StageTimes) if field.name != "frames")


def row_of(frame: Frame, found: FramePrediction) -> dict[str, Any]:
    """Describe a mask.

    Parameters
    ----------
    frame : Frame
        The frame.
    found : FramePrediction
        Its result.

    Returns
    -------
    dict
        Size, pixel size, area in px and where it is known in mm^2, mean probability in the mask, probability of a
        vessel in the frame, and seconds of each stage.
    """
    height, width = frame.size
    spacing = frame.spacing_mm
    return {
        "height_px": height,
        "width_px": width,
        "spacing_mm": None if spacing is None else list(spacing),
        "area_px": found.area_px,
        "area_mm2": None if spacing is None else found.area_px * spacing[0] * spacing[1],
        "confidence": found.confidence,
        "presence": found.presence,
        **{stage: getattr(found.times, stage) for stage in STAGES},
    }


def overlay(image: UInt8[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Draw the outline of a mask on its frame.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w)
        Grey values.
    mask : ndarray of bool, shape (h, w)
        The mask.

    Returns
    -------
    ndarray of uint8, shape (h, w, 3)
        RGB picture; the outermost pixels of the mask are coloured.
    """
    picture = np.repeat(image[..., None], 3, axis=2)
    picture[mask & ~binary_erosion(mask, border_value=1)] = OUTLINE
    return picture


def described_row(frame: NamedFrame, row: Mapping[str, Any], resumed: bool) -> dict[str, Any]:
    """Put a mask's row together with its place.

    Parameters
    ----------
    frame : NamedFrame
        The frame.
    row : mapping
        What ``row_of`` gave.
    resumed : bool
        Whether the mask is from an earlier call.

    Returns
    -------
    dict
        The row.
    """
    place = {"name": frame.name, "mask": f"{frame.name}.png", "source": frame.source, "frame": frame.number}
    return {**place, **row, "resumed": resumed}


def record(
    rows: Sequence[Mapping[str, Any]],
    unreadable: Sequence[str],
    model: SegmentationModel,
    about: Mapping[str, Any],
    elapsed_s: float,
) -> dict[str, Any]:
    """Put together what ``segmentation.json`` holds.

    Parameters
    ----------
    rows : sequence of mapping
        A row a mask.
    unreadable : sequence of str
        What could not be read and why.
    model : SegmentationModel
        The model as it was used.
    about : mapping
        Paths and settings of the call.
    elapsed_s : float
        Seconds from the first file read to the last mask written.

    Returns
    -------
    dict
        Plain values.
    """
    new = [row for row in rows if not row["resumed"]]
    areas_mm2 = [row["area_mm2"] for row in rows if row["area_mm2"] is not None]
    totals = {
        "images": len(rows),
        "with_vessel": sum(row["area_px"] > 0 for row in rows),
        "resumed": len(rows) - len(new),
        "unreadable": len(unreadable),
        "area_px_mean": float(np.mean([row["area_px"] for row in rows])),
        "area_mm2_mean": float(np.mean(areas_mm2)) if areas_mm2 else None,
        "elapsed_s": elapsed_s,
        "frames_per_s": len(new) / elapsed_s if new else None,
        **{stage: float(sum(row[stage] for row in new)) for stage in STAGES},
    }
    return {
        **about,
        "model": {
            "digest": model.digest,
            "networks": [{"name": each.name, "network": each.recipe.name} for each in model.members],
            "calibration": _plain(model.calibration),
            "postprocessing": _plain(model.postprocessing),
            "min_presence": model.min_presence,
            "flips": model.flips,
            "certificate": dict(model.certificate),
        },
        "totals": totals,
        "unreadable": list(unreadable),
        "images": list(rows),
    }


def findings(report: Mapping[str, Any]) -> tuple[str, ...]:
    """Say what was found.

    Parameters
    ----------
    report : mapping
        What ``record`` gave.

    Returns
    -------
    tuple of str
        Sentences.
    """
    totals, certificate = report["totals"], report["model"]["certificate"]
    said = [f"{totals['with_vessel']} of {totals['images']} images show a vessel; masks have their names."]
    if totals["resumed"]:
        said.append(f"{totals['resumed']} masks of the same images by the same model were there already.")
    said.extend(f"Left out: {reason}." for reason in report["unreadable"])
    if "verdict" in certificate:
        said.append(f"The model's certificate: {certificate['verdict']}.")
    else:
        said.append("The model has no certificate: nobody has said on whom it was tested.")
    if totals["frames_per_s"] is not None:
        said.append(
            f"{totals['frames_per_s']:.1f} frames a second from file to mask, by {report['engine']}, of which "
            f"{totals['network_s'] / totals['elapsed_s']:.0%} of the time in the network."
        )
    said.append("segmentation.json has area, confidence, presence and timing of each.")
    return tuple(said)


def _plain(part: Any) -> dict[str, Any] | None:
    return None if part is None else dataclasses.asdict(part)
