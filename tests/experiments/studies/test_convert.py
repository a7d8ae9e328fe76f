"""A sweep goes through every format and comes back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plus_sequences import tracked_sequence
from sweeps import CALIBRATION, assert_same_sweep, known_sweep

from experiments.errors import InputError
from experiments.outcome import Silent
from experiments.studies import convert
from registration import transforms
from registration.readers.auto import AutoReader
from registration.readers.chain.graph import TransformGraph
from registration.readers.folder import write_folder
from registration.readers.plus.config import device_set_xml
from registration.readers.plus.fields import write_sequence
from registration.readers.plus.reader import PlusReader
from registration.synchronisation import synchronise


def converted(source: Path, target: Path, form: str, max_gap_s: float = 0.1) -> convert.Outcome:
    target.mkdir()
    return convert.run(
        input=str(source),
        acquisition=AutoReader(),
        format=form,
        max_gap_s=max_gap_s,
        workspace=target,
        progress=Silent(),
    )


@pytest.fixture
def source(tmp_path: Path) -> Path:
    write_folder(tmp_path / "source", known_sweep())
    return tmp_path / "source"


@pytest.mark.parametrize("form", ["ros2_mcap", "ros2_sqlite3", "folder"])
def test_streams_keep_their_times_through_bags_and_folders(source: Path, tmp_path: Path, form: str) -> None:
    outcome = converted(source, tmp_path / "a", form)
    converted(tmp_path / "a", tmp_path / "b", "folder")
    assert_same_sweep(AutoReader()(tmp_path / "b"), known_sweep())
    assert outcome.metrics == {"frames": 6.0, "frames_dropped": 0.0}


@pytest.mark.parametrize("form", ["plus_mha", "plus_nrrd"])
def test_frames_keep_their_place_through_plus(source: Path, tmp_path: Path, form: str) -> None:
    converted(source, tmp_path / "a", form)
    converted(tmp_path / "a", tmp_path / "b", "folder")
    found = AutoReader()(tmp_path / "b")
    np.testing.assert_array_equal(found.images, known_sweep().images)
    expected = synchronise(known_sweep(), 0.1).world_A_pixel
    np.testing.assert_allclose(synchronise(found, 1.0).world_A_pixel, expected, atol=1e-9)


def test_calibrations_that_contradict_each_other_are_told(tmp_path: Path) -> None:
    write_sequence(tmp_path / "a.igs.mha", tracked_sequence())
    moved = transforms.translation((0.0, 0.0, 12.0)) @ CALIBRATION.probe_A_pixel
    (tmp_path / "set.xml").write_text(device_set_xml(TransformGraph({("Image", "Probe"): moved})))
    (tmp_path / "out").mkdir()
    outcome = convert.run(
        input=str(tmp_path / "a.igs.mha"),
        acquisition=PlusReader(device_set=str(tmp_path / "set.xml")),
        format="folder",
        max_gap_s=1.0,
        workspace=tmp_path / "out",
        progress=Silent(),
    )
    assert "ImageToProbe (device set) was taken" in outcome.findings[1]
    assert "up to 12.0 mm elsewhere" in outcome.findings[1]


def test_frames_without_a_pose_are_told(source: Path, tmp_path: Path) -> None:
    outcome = converted(source, tmp_path / "a", "plus_mha", max_gap_s=0.02)
    assert outcome.metrics["frames_dropped"] + outcome.metrics["frames"] == 6.0
    assert outcome.metrics["frames_dropped"] > 0
    assert "in a gap between poses longer than max_gap_s" in outcome.findings[0]


def test_missing_input_and_unknown_format_are_refused(source: Path) -> None:
    with pytest.raises(InputError, match="input: expected a file or folder, received 'absent'"):
        convert.check(input="absent", format="folder")
    with pytest.raises(InputError, match=r"format: expected folder, .* received 'dicom'"):
        convert.check(input=str(source), format="dicom")
