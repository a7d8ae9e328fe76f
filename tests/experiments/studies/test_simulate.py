"""A simulated sweep as files: what the reader reads is what was simulated, and its truth fits its model."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from experiments.errors import InputError
from experiments.outcome import Silent
from experiments.studies import simulate
from registration import transforms
from registration.io.surfaces import read_surface
from registration.metrics.surface_distance import SurfaceDistance
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.settings import PhantomSettings
from registration.readers.folder import FolderReader
from registration.reconstruction.contours import ContourExtractor

PHANTOM = PhantomSettings(
    subset="vein",
    scanner=Scanner(height_px=96, width_px=96),
    motion=Motion(frames=12),
    deformation=Deformation(bend_mm=0.0, pressure_mm=0.0),
)


def test_the_files_hold_the_sweep_and_its_truth(tmp_path: Path) -> None:
    outcome = simulate.run(phantom=PHANTOM, sweep_index=2, workspace=tmp_path, progress=Silent())

    assert outcome.metrics["frames"] == 12
    (row,) = outcome.tables["simulated sweep"].to_dict("records")
    assert (row["phantom"], row["sweep"], row["frames"], row["length_mm"]) == ("vein", 2, 12, 60.0)
    sweep = FolderReader()(tmp_path / "sweep")
    masks = np.stack(
        [np.asarray(Image.open(path)) > 0 for path in sorted((tmp_path / "masks").glob("*.png"))]
    )
    assert masks.shape == sweep.images.shape
    truth = np.load(tmp_path / "truth.npz")
    # Contours of the true masks at their true places, taken to the ct frame, lie on the model from CT.
    cloud_mm = ContourExtractor()(masks, truth["world_A_pixel"]).points_mm
    ct_T_world = np.array(json.loads((tmp_path / "truth.json").read_text())["ct_T_world"])
    distances_mm = SurfaceDistance(read_surface(tmp_path / "model.ply"))(
        transforms.apply(ct_T_world, cloud_mm)
    )
    assert np.sqrt((distances_mm**2).mean()) < 0.4
    assert truth["centerline_mm"].shape[1] == 3
    assert len(truth["radius_mm"]) == len(truth["centerline_mm"])


@pytest.mark.parametrize("number", [-1, 0.5, True])
def test_a_wrong_number_is_refused(number: object) -> None:
    with pytest.raises(InputError, match="sweep_index: expected a whole number from 0"):
        simulate.check(sweep_index=number)
