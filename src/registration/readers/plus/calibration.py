"""The chains of transforms in a PLUS recording and a device set: the frames' poses, and where their pixels lie."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64

from registration import transforms
from registration.calibration.probe import corner_displacement_mm
from registration.errors import InputError
from registration.readers.chain.chains import Chain, Link, calibration_order, chains, links_from, pose_order
from registration.readers.chain.graph import TransformGraph
from registration.readers.plus.fields import TRANSFORM, frame_transform, transform_names
from registration.readers.plus.sequence import PlusSequence

# PLUS records where a cropped image lies in the one that was taken as ImageToCroppedImage.
CROPPED = "Cropped"
# Chains that put the same point closer together than this agree, but for digits in a file.
_SAME_MM, _SAME_DEG = 0.1, 0.5


@dataclass(frozen=True)
class ImagePlacement:
    """Where the pixels lie on the tracked marker.

    Parameters
    ----------
    ee_A_pixel : ndarray, shape (4, 4)
        Map from the pixels of the first frame with one to the marker, in mm.
    image_A_pixel : ndarray, shape (n, 4, 4), or None
        Map from each frame's pixels to that frame's; None where all are the same.
    reasons : ndarray of str, shape (n,)
        Why a frame has no map, empty where it has.
    notes : tuple of str
        What contradicts itself, in sentences.
    """

    ee_A_pixel: Float64[np.ndarray, "4 4"]
    image_A_pixel: Float64[np.ndarray, "n 4 4"] | None
    reasons: np.ndarray
    notes: tuple[str, ...]


def known_frames(defined: TransformGraph, known: tuple[str, ...]) -> set[str]:
    """Collect the coordinate frames that settings and a device set name.

    Parameters
    ----------
    defined : TransformGraph
        Transforms of the device set.
    known : tuple of str
        Coordinate frames that settings name.

    Returns
    -------
    set of str
        Names.
    """
    return {*known, *(frame for pair in defined.edges for frame in pair)}


def recorded_links(
    sequence: PlusSequence, defined: TransformGraph, known: tuple[str, ...], path: Path
) -> tuple[Link, ...]:
    """Collect the transforms of a recording and of a device set.

    Parameters
    ----------
    sequence : PlusSequence
        Recording.
    defined : TransformGraph
        Transforms of the device set.
    known : tuple of str
        Coordinate frames that settings name.
    path : Path
        Name of the file, for messages.

    Returns
    -------
    tuple of Link
        All transforms.
    """
    pairs = transform_names(sequence, known_frames(defined, known))
    stacks = {pair: frame_transform(sequence, *pair, str(path)) for pair in pairs}
    return links_from(stacks, defined.edges)


def poses(
    links: tuple[Link, ...], ee: str, world: str, count: int, path: Path
) -> tuple[Float64[np.ndarray, "n 4 4"], np.ndarray, tuple[str, ...]]:
    """Compose the poses of every frame.

    Parameters
    ----------
    links : tuple of Link
        Transforms of the recording and the device set.
    ee : str
        PLUS's name of the end effector.
    world : str
        PLUS's name of the world.
    count : int
        Number of frames n.
    path : Path
        Name of the file, for messages.

    Returns
    -------
    world_A_ee : ndarray, shape (n, 4, 4)
        Poses as recorded, in mm.
    reasons : ndarray of str, shape (n,)
        Why a frame has no pose, empty where it has.
    notes : tuple of str
        What contradicts the poses, in sentences.

    Raises
    ------
    InputError
        If no chain of transforms leads from one to the other.
    """
    try:
        found = chains(links, ee, world, pose_order)
        best = found[0]
        world_A_ee = np.array(np.broadcast_to(best.matrix, (count, 4, 4)))
        reasons = _reasons(best.links, count)
        notes = _pose_notes(found, world_A_ee, reasons == "", path)
    except InputError as failure:
        raise InputError(f"{path}: {failure}") from failure
    return world_A_ee, reasons, notes


def image_placement(
    links: tuple[Link, ...], image: str, ee: str, sequence: PlusSequence, path: Path
) -> ImagePlacement:
    """Compose the calibration of every frame, from the pixels that the file holds to the tracked marker.

    A frame that was cropped has the pixels of CroppedImage, not of Image. What a device set states comes
    before what the recording states; where the two differ, the notes report by how much.

    Parameters
    ----------
    links : tuple of Link
        Transforms of the recording and the device set.
    image : str
        PLUS's name of the image.
    ee : str
        PLUS's name of the tracked marker.
    sequence : PlusSequence
        Recording.
    path : Path
        Name of the file, for messages.

    Returns
    -------
    ImagePlacement
        Maps from pixels to the marker.

    Raises
    ------
    InputError
        If no chain of transforms leads from one to the other.
    """
    cropped = CROPPED + image
    is_cropped = any({link.source, link.target} == {image, cropped} for link in links)
    found = chains(links, cropped if is_cropped else image, ee, calibration_order)
    best = found[0]
    count, height, width = sequence.pixels.shape[:3]
    # A transform that holds for all frames is taken from those where it is valid.
    reasons = _reasons(tuple(link for link in best.links if link.moving), count)
    ee_A_pixel = np.asarray(best.matrix)
    valid = np.flatnonzero(reasons == "")
    if not len(valid):
        raise InputError(f"{path}: expected at least one frame with a valid {best.text}, found none")
    first = ee_A_pixel[valid[0]] if ee_A_pixel.ndim == 3 else ee_A_pixel
    notes = (
        *_unused(links, best, path),
        *_image_remarks(found, ee_A_pixel, (height, width), reasons == "", path),
    )
    moving = ee_A_pixel.ndim == 3 and not (ee_A_pixel[valid] == first).all()
    return ImagePlacement(
        ee_A_pixel=first,
        image_A_pixel=np.linalg.inv(first) @ ee_A_pixel if moving else None,
        reasons=reasons,
        notes=notes,
    )


def _unused(links: tuple[Link, ...], best: Chain, path: Path) -> tuple[str, ...]:
    """Whether a device set was named that holds nothing of the calibration."""
    given = [link.name for link in links if link.given]
    if best.given or not given:
        return ()
    return (
        f"{path.name}: the device set ({', '.join(given)}) leads to no calibration: {best.text} of the recording was "
        "taken.",
    )


def _reasons(links: tuple[Link, ...], count: int) -> np.ndarray:
    reasons = np.full(count, "", dtype="U96")
    for link in links:
        if link.valid is not None:
            reasons[~link.valid & (reasons == "")] = f"{link.name}{TRANSFORM} INVALID"
    return reasons


def _pose_notes(
    found: list[Chain], world_A_ee: np.ndarray, valid: Bool[np.ndarray, " n"], path: Path
) -> tuple[str, ...]:
    """By how much another chain puts the end effector elsewhere, for the one that differs most."""
    worst_mm, worst_deg, other_text = 0.0, 0.0, ""
    for other in found[1:]:
        both = valid & (_reasons(other.links, len(valid)) == "")
        if not both.any():
            continue
        apart = np.linalg.inv(np.broadcast_to(other.matrix, world_A_ee.shape)[both]) @ world_A_ee[both]
        moved_mm = float(np.linalg.norm(apart[:, :3, 3], axis=1).max())
        turned_deg = float(transforms.rotation_angle_deg(transforms.nearest_rigid(apart)).max())
        if max(moved_mm / _SAME_MM, turned_deg / _SAME_DEG) > max(worst_mm / _SAME_MM, worst_deg / _SAME_DEG):
            worst_mm, worst_deg, other_text = moved_mm, turned_deg, other.text
    if worst_mm <= _SAME_MM and worst_deg <= _SAME_DEG:
        return ()
    return (
        f"{path.name}: its poses contradict each other: {found[0].text} was taken; {other_text} would put the end "
        f"effector up to {worst_mm:.1f} mm and {worst_deg:.1f} degrees elsewhere.",
    )


def _image_remarks(
    found: list[Chain],
    ee_A_pixel: np.ndarray,
    size: tuple[int, int],
    valid: Bool[np.ndarray, " n"],
    path: Path,
) -> tuple[str, ...]:
    """By how much another chain puts the image's corners elsewhere, for the one that differs most."""
    worst_mm, other_text = 0.0, ""
    shape = (len(valid), 4, 4)
    for other in found[1:]:
        both = valid & (_reasons(other.links, len(valid)) == "")
        if not both.any():
            continue
        pairs = zip(
            np.broadcast_to(ee_A_pixel, shape)[both], np.broadcast_to(other.matrix, shape)[both], strict=True
        )
        apart_mm = max(float(corner_displacement_mm(own, its, *size).max()) for own, its in pairs)
        if apart_mm > worst_mm:
            worst_mm, other_text = apart_mm, other.text
    if worst_mm <= _SAME_MM:
        return ()
    return (
        f"{path.name}: its calibrations contradict each other: {found[0].text} was taken; {other_text} would put the "
        f"image's corners up to {worst_mm:.1f} mm elsewhere.",
    )
