"""Each sentence about a model stands there when there is reason for it, and only then."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from vessels import bent_tube

from experiments.studies.ct_model.notes import remarks
from experiments.studies.ct_model.report import CtModel
from registration.ct_model.loader import ModelInput
from registration.ct_model.vessel_mask import VesselMask
from registration.geometry.mesh_quality import mesh_quality
from registration.geometry.mesh_repair import repair
from registration.geometry.shapes import Mesh

TUBE = bent_tube()
MASK = VesselMask(
    np.ones((4, 5, 6), dtype=bool), np.diag([0.5, 0.5, 2.0, 1.0]), np.zeros((3, 2), dtype=bool), 7, 0, 0, 0
)
LABELLED = ModelInput(TUBE, "mm", "header", mask=MASK)


def model(source: ModelInput, refusal: str = "") -> CtModel:
    return CtModel(Path("a.nii"), source, None, refusal, mesh_quality(source.mesh), {})


def of_mesh(mesh: Mesh) -> ModelInput:
    done = repair(mesh)
    return ModelInput(done.mesh, "mm", "lps", repaired=done)


def test_a_sound_model_needs_no_words() -> None:
    assert remarks(model(LABELLED)) == ()
    assert remarks(model(of_mesh(TUBE))) == ()


@pytest.mark.parametrize(
    "change, sentence",
    [
        (
            {"pieces_dropped": 2, "voxels_dropped": 40},
            "Label 7 lies in 3 pieces: only the largest was taken, 40 voxels",
        ),
        ({"voxels_filled": 12}, "12 voxels in cavities of the label were filled."),
    ],
)
def test_what_was_done_to_a_label(change: dict[str, int], sentence: str) -> None:
    (found,) = remarks(model(replace(LABELLED, mask=replace(MASK, **change))))
    assert found.startswith(sentence)


def test_the_share_of_what_was_left_out_is_told_where_it_is_no_speck() -> None:
    inside = int(MASK.inside.sum())
    for dropped, told in (
        (inside // 50, "of the others were left out."),
        (inside, "left out, 50 % of all: where"),
    ):
        mask = replace(MASK, pieces_dropped=1, voxels_dropped=dropped)
        (found,) = remarks(model(replace(LABELLED, mask=mask)))
        assert told in found
    half = Mesh(
        np.concatenate([TUBE.vertices_mm, TUBE.vertices_mm[:, ::-1] + 500.0]),
        np.concatenate([TUBE.triangles, TUBE.triangles[:-4, ::-1] + len(TUBE.vertices_mm)]),
    )
    (found,) = remarks(model(of_mesh(half)))
    assert found.endswith(
        "50 % of all: where they are the vessel's, close the gap between them in the segmentation first."
    )


def test_sides_where_the_scan_ended_are_named() -> None:
    cut = np.array([[True, False], [False, True], [False, False]])
    (found,) = remarks(model(replace(LABELLED, mask=replace(MASK, cut=cut))))
    assert "touches the border of the volume (first i, last j)" in found


def test_a_lost_branch_is_told_beyond_two_voxels() -> None:
    assert remarks(model(replace(LABELLED, lost_mm=3.9))) == ()
    (found,) = remarks(model(replace(LABELLED, lost_mm=4.1)))
    assert found.startswith("Parts of the label up to 4.1 mm away from the surface are too thin")


def test_what_was_done_to_a_mesh() -> None:
    far = Mesh(TUBE.vertices_mm[:3] + 500.0, np.array([[0, 1, 2]]))
    both = Mesh(
        np.concatenate([TUBE.vertices_mm, far.vertices_mm]),
        np.concatenate(
            [TUBE.triangles[:, ::-1], TUBE.triangles[:1, ::-1], far.triangles + len(TUBE.vertices_mm)]
        ),
    )
    pieces, dropped, turned = remarks(model(of_mesh(both)))
    assert pieces.startswith("The mesh lies in 2 pieces: only the largest was taken, ")
    assert dropped == "1 triangles without area or there twice were left out."
    assert turned == f"{len(TUBE.triangles)} triangles were wound the other way and have been turned over."


def test_holes_and_doubled_walls_are_told() -> None:
    pierced = Mesh(TUBE.vertices_mm, np.delete(TUBE.triangles, 2000, axis=0))
    assert remarks(model(ModelInput(pierced, "mm", "lps"))) == ("The surface has 1 holes in its wall.",)
    fin = np.concatenate([TUBE.triangles, [[*TUBE.triangles[0, :2], 1000]]])
    found = remarks(model(ModelInput(Mesh(TUBE.vertices_mm, fin), "mm", "lps")))
    assert any("crosses or doubles itself" in sentence for sentence in found)


def test_why_there_is_no_centerline() -> None:
    assert remarks(model(LABELLED, "surface: expected two ends")) == (
        "There is no centerline: surface: expected two ends.",
    )
