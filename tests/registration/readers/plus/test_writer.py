"""Sweeps to PLUS sequences and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sweeps import assert_same_sweep, known_sweep, world_T_ee

from registration.readers.plus.fields import read_sequence, transform_names
from registration.readers.plus.reader import PlusReader
from registration.readers.plus.writer import write_plus
from registration.sweep import TrackedSweep
from registration.synchronisation import synchronise

FORMATS = ["sweep.igs.mha", "sweep.igs.nrrd"]


@pytest.mark.parametrize("name", FORMATS)
def test_sweep_comes_back_when_poses_and_frames_share_times(tmp_path: Path, name: str) -> None:
    sweep = known_sweep()
    shared = TrackedSweep(
        sweep.images,
        sweep.image_times_s,
        world_T_ee(sweep.image_times_s),
        sweep.image_times_s,
        sweep.calibration,
    )
    assert write_plus(tmp_path / name, shared, max_gap_s=1.0) == {}
    assert_same_sweep(PlusReader()(tmp_path / name), shared)


def test_writing_gives_each_frame_its_pose_and_counts_what_has_none(tmp_path: Path) -> None:
    sweep = known_sweep()
    late = TrackedSweep(
        sweep.images, sweep.image_times_s + 0.3, sweep.world_T_ee, sweep.pose_times_s, sweep.calibration
    )
    dropped = write_plus(tmp_path / "late.igs.mha", late, max_gap_s=0.05)
    assert dropped == {"after the last pose": 2}
    found = PlusReader()(tmp_path / "late.igs.mha")
    np.testing.assert_array_equal(found.images, late.images[:4])
    expected = synchronise(late, 0.05).world_A_pixel
    np.testing.assert_allclose(synchronise(found, 1.0).world_A_pixel, expected, atol=1e-9)


@pytest.mark.parametrize("name", FORMATS)
def test_tracker_only_sweep(tmp_path: Path, name: str) -> None:
    sweep = known_sweep(frame_count=0)
    write_plus(tmp_path / name, sweep, max_gap_s=1.0)
    found = PlusReader()(tmp_path / name)
    assert found.images.size == 0
    assert len(found.image_times_s) == 0
    np.testing.assert_allclose(found.world_T_ee, sweep.world_T_ee, atol=1e-9)
    np.testing.assert_allclose(found.pose_times_s, sweep.pose_times_s)


def test_names_of_the_frames_are_those_of_the_reader(tmp_path: Path) -> None:
    names = PlusReader(world="Base", ee="Flange", image="Video")
    write_plus(tmp_path / "a.igs.mha", known_sweep(), max_gap_s=1.0, reader=names)
    assert transform_names(read_sequence(tmp_path / "a.igs.mha")) == [("Flange", "Base"), ("Video", "Flange")]
    assert len(names(tmp_path / "a.igs.mha").images) == 6
