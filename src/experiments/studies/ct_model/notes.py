"""What a user has to know of a model made from a label map or a mesh, in sentences."""

from __future__ import annotations

from experiments.studies.ct_model.report import CtModel

# Smoothing takes steps of a voxel off; what lies farther from the surface than so many voxels was a branch.
LOST_VOXELS = 2.0
# Pieces beside the largest that together are less than this share are specks of a segmentation.
SPECK_SHARE = 0.05


def remarks(model: CtModel) -> tuple[str, ...]:
    """State what a user has to know of the model.

    Parameters
    ----------
    model : CtModel
        Finished model.

    Returns
    -------
    tuple of str
        Sentences.
    """
    lumen = model.source.lumen
    found = [*_of_label(model), *_of_mesh(model), *_of_surface(model)]
    if lumen is not None:
        found.insert(0, lumen.described)
    if model.refusal:
        found.append(f"There is no centerline: {model.refusal}.")
    return tuple(found)


def _of_label(model: CtModel) -> list[str]:
    mask = model.source.mask
    if mask is None:
        return []
    found = []
    stated, used = model.source.stated_units, model.source.units
    if stated and stated != used:
        found.append(f"The header says that lengths are in {stated}: units={used} was taken instead.")
    if mask.pieces_dropped:
        taken = int(mask.inside.sum()) - mask.voxels_filled
        share = mask.voxels_dropped / (mask.voxels_dropped + taken)
        found.append(
            f"Label {mask.label} lies in {mask.pieces_dropped + 1} pieces: only the largest was taken, "
            f"{mask.voxels_dropped} voxels of the others were left out{_of_all(share)}"
        )
    if mask.voxels_filled:
        found.append(f"{mask.voxels_filled} voxels in cavities of the label were filled.")
    if model.cut_sides:
        found.append(
            f"The label touches the border of the volume ({', '.join(model.cut_sides)}): the vessel goes on there, and "
            "the surface has an open end."
        )
    if len(model.cut_sides) == 6:
        found.append(
            "It touches all six sides, as in a volume that was cropped to its label: ends that are none then need the "
            "whole volume."
        )
    if model.source.lost_mm > LOST_VOXELS * float(mask.spacing_mm.max()):
        found.append(
            f"Parts of the label up to {model.source.lost_mm:.1f} mm away from the surface are too thin for its "
            "voxels: the surface does not show them."
        )
    return found


def _of_mesh(model: CtModel) -> list[str]:
    done = model.source.repaired
    if done is None:
        return []
    found = []
    if done.pieces_dropped and done.lumen is None:
        share = done.area_dropped_mm2 / (done.area_dropped_mm2 + float(done.mesh.areas_mm2.sum()))
        found.append(
            f"The mesh lies in {done.pieces_dropped + 1} pieces: only the largest was taken, "
            f"{done.area_dropped_mm2:.1f} mm2 of the others were left out{_of_all(share)}"
        )
    if done.triangles_dropped:
        found.append(f"{done.triangles_dropped} triangles without area or there twice were left out.")
    if done.triangles_turned:
        found.append(f"{done.triangles_turned} triangles were wound the other way and have been turned over.")
    return found


def _of_surface(model: CtModel) -> list[str]:
    found = []
    if not (model.quality.manifold and model.quality.oriented):
        found.append("The surface crosses or doubles itself: what lies inside is not certain everywhere.")
    if model.quality.holes:
        found.append(f"The surface has {model.quality.holes} holes in its wall.")
    return found


def _of_all(share: float) -> str:
    """How much of the whole was left out; where that is no speck, what to do."""
    if share < SPECK_SHARE:
        return "."
    return (
        f", {100 * share:.0f} % of all: where they are the vessel's, close the gap between them in the segmentation "
        "first."
    )
