"""What speaks for a mistake in the files, or for a pose that was never searched for: sentences for the user."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from experiments.studies.register.pair import Pair, Side
from experiments.studies.register.record import Registered
from registration.geometry.mesh_topology import pieces
from registration.geometry.shapes import Mesh, diagonal_mm, points_of
from registration.rigid.result import ACCEPTED, NOT_JUDGED

# A model is as long as the sweep at least; one this much shorter is of other units more often than a short piece.
SHORT_SHARE = 0.35
# Share of a mesh's area in pieces beside the largest that is worth a word.
PIECE_SHARE = 0.05
# Below this share of moving points near the fixed surface, a pose is hardly right.
FEW_INLIERS = 0.5


def doubts(found: Registered) -> list[str]:
    """List what the user had better look at.

    Parameters
    ----------
    found : Registered
        Registered pair.

    Returns
    -------
    list of str
        Sentences; where the result was accepted, only that axes were assumed.
    """
    pair, result = found.pair, found.result
    sentences = list(_of_axes(pair))
    if result.verdict == ACCEPTED:
        return sentences
    share = found.residuals.inlier_share
    if result.verdict == NOT_JUDGED and share < FEW_INLIERS and pair.initial is None:
        sentences.append(
            f"Only {100 * share:.0f} % of the moving points lie on the fixed surface: {found.name} has hardly found "
            "the pose. Give initial=, or take rigid=multistart, which searches."
        )
    sentences += _of_sizes(pair)
    for name, side in _sides(pair):
        sentences += _of_pieces(name, side)
    return sentences


def _sides(pair: Pair) -> tuple[tuple[str, Side], ...]:
    return ("moving", pair.moving), ("fixed", pair.fixed)


def _of_axes(pair: Pair) -> Iterator[str]:
    # PLY is what this project writes itself, in LPS.
    assumed = [
        (name, side) for name, side in _sides(pair) if side.assumed and side.path.suffix.lower() != ".ply"
    ]
    if assumed:
        files = " and ".join(side.path.name for _, side in assumed)
        settings = " or ".join(f"{name}_space=ras" for name, _ in assumed)
        states, was = ("states", "was") if len(assumed) == 1 else ("state", "were")
        yield f"{files} {states} no axes and {was} taken as LPS; {settings} says otherwise."


def _of_sizes(pair: Pair) -> Iterator[str]:
    moving_mm, fixed_mm = (diagonal_mm(points_of(side.surface)) for _, side in _sides(pair))
    if fixed_mm < SHORT_SHARE * moving_mm:
        yield (
            f"The fixed surface is {fixed_mm:.3g} mm across and the moving one {moving_mm:.3g} mm: in centimetres or "
            "metres it needs fixed_unit=cm or fixed_unit=m."
        )


def _of_pieces(name: str, side: Side) -> Iterator[str]:
    if not isinstance(side.surface, Mesh):
        return
    count, of_triangle = pieces(side.surface)
    areas_mm2 = np.bincount(of_triangle, side.surface.areas_mm2, count)
    others = 1 - areas_mm2.max() / areas_mm2.sum()
    if count > 1 and others > PIECE_SHARE:
        yield (
            f"{name}: {side.path.name} lies in {count} pieces, {100 * others:.0f} % of the area outside the largest: "
            "what is not the vessel has to be removed first (study=ct_model takes the largest)."
        )
