"""Sequence files: what is written comes back, and what the frames' fields say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plus_sequences import tracked_sequence

from registration import transforms
from registration.errors import InputError
from registration.readers.auto import AutoReader
from registration.readers.plus.fields import (
    frame_times_s,
    frame_transform,
    read_sequence,
    transform_names,
    write_sequence,
)
from registration.readers.plus.sequence import PlusSequence

FORMATS = ["sweep.igs.mha", "sweep.igs.nrrd"]


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("compressed", [True, False])
def test_sequence_comes_back_with_the_same_bytes_and_fields(
    tmp_path: Path, name: str, compressed: bool
) -> None:
    sequence = tracked_sequence(("OK", "INVALID", "MISSING", "OK"))
    write_sequence(tmp_path / name, sequence, compressed)
    found = read_sequence(tmp_path / name)
    assert found.pixels.dtype == np.uint8
    assert found.pixels.tobytes() == sequence.pixels.tobytes()
    assert found.frame_fields == sequence.frame_fields
    matrices, valid = frame_transform(found, "Probe", "Tracker", name)
    assert valid.tolist() == [True, False, False, True]
    expected, _ = frame_transform(sequence, "Probe", "Tracker", name)
    np.testing.assert_allclose(matrices, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("compressed", [True, False])
def test_what_is_written_is_read_by_simpleitk(tmp_path: Path, compressed: bool) -> None:
    sitk = pytest.importorskip("SimpleITK")
    sequence = tracked_sequence()
    for name in FORMATS:
        write_sequence(tmp_path / name, sequence, compressed)
    volume = sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / FORMATS[0])))
    np.testing.assert_array_equal(volume, sequence.pixels)
    # ITK takes a list axis of NRRD as the components of a pixel.
    picture = sitk.GetArrayFromImage(sitk.ReadImage(str(tmp_path / FORMATS[1])))
    np.testing.assert_array_equal(np.moveaxis(picture, 2, 0), sequence.pixels)


@pytest.mark.parametrize("name", ["a.IGS.MHA", "a.igs.mhd", "A.MHD", "a.IGS.NRRD", "a.igs.nhdr", "A.NHDR"])
def test_every_suffix_in_any_case(tmp_path: Path, name: str) -> None:
    sequence = tracked_sequence()
    kind = "mha" if "m" in name.lower().rpartition(".")[2] else "nrrd"
    write_sequence(tmp_path / f"x.igs.{kind}", sequence, compressed=False)
    content = (tmp_path / f"x.igs.{kind}").read_bytes()
    raw = sequence.pixels.tobytes()
    head = content[: -len(raw)]
    if name.lower().endswith("hd"):
        head, data = head.replace(b"ElementDataFile = LOCAL", b"ElementDataFile = a.raw"), b""
    elif name.lower().endswith("hdr"):
        head, data = head.replace(b"encoding: raw", b"encoding: raw\ndata file: a.raw"), b""
    else:
        data = raw
    (tmp_path / "a.raw").write_bytes(raw)
    (tmp_path / name).write_bytes(head + data)
    found = read_sequence(tmp_path / name)
    np.testing.assert_array_equal(found.pixels, sequence.pixels)
    assert found.frame_fields == sequence.frame_fields
    assert AutoReader()(tmp_path / name).images.shape == sequence.pixels.shape


def test_files_of_both_orientations_and_of_a_tracker_alone(real_data: Path) -> None:
    plus = real_data / "plus"
    # MF and MFA differ in the stacking of volumes, not in the frames: the beam enters from the top in both, so
    # the upper quarter is the brightest.
    for name in ("BoneUltrasound_L14.igs.mha", "SpinePhantomFreehand.igs.mha"):
        brightness = read_sequence(plus / name).pixels.mean(axis=(0, 2)).reshape(4, -1).mean(axis=1)
        assert brightness.argmax() == 0
    tracker = read_sequence(plus / "WaterTankBottomTranslationTrackerBuffer.igs.mha")
    assert tracker.tracker_only
    assert len(tracker.frame_fields) == 5000
    assert transform_names(tracker)[:2] == [("Probe", "Tracker"), ("Reference", "Tracker")]


def test_nrrd_of_plus(real_data: Path) -> None:
    sequence = read_sequence(real_data / "plus" / "NrrdSample.igs.nrrd")
    assert sequence.pixels.shape == (1, 256, 256)
    assert sequence.pixels.dtype == np.int16
    assert sequence.frame_fields == ({"ImageStatus": "OK"},)


def test_interpolated_poses_of_plus_do_not_jump(real_data: Path) -> None:
    path = real_data / "plus" / "TransformInterpolationTest.igs.mha"
    sequence = read_sequence(path)
    matrices, valid = frame_transform(sequence, "Probe", "Tracker", path.name)
    assert (len(valid), int(valid.sum())) == (500, 499)
    times_s = frame_times_s(sequence, "filtered", path.name)
    tracker_T_probe = transforms.nearest_rigid(matrices[valid])
    # The toolkit's own test of this file samples at five times the recorded rate.
    between_s = np.linspace(times_s[valid][0], times_s[valid][-1], 5 * len(times_s))
    poses = transforms.interpolate(between_s, times_s[valid], tracker_T_probe)
    step = transforms.invert_rigid(poses[:-1]) @ poses[1:]
    assert np.linalg.norm(step[:, :3, 3], axis=1).max() < 0.5
    assert transforms.rotation_angle_deg(step).max() < 1.0
    # The recorded times come out as the recorded poses.
    np.testing.assert_allclose(
        transforms.interpolate(times_s[valid], times_s[valid], tracker_T_probe), tracker_T_probe
    )


@pytest.mark.parametrize("name", ["a.mhb", "a.png", "a"])
def test_other_suffixes_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(
        InputError, match=r"expected a file that ends in \.mha, \.mhd, \.nrrd, \.nhdr, received"
    ):
        read_sequence(tmp_path / name)
    with pytest.raises(InputError, match=r"expected a name that ends in \.mha or \.nrrd, received"):
        write_sequence(tmp_path / name, tracked_sequence())


def test_fields_that_say_nothing_useful_are_refused() -> None:
    sequence = tracked_sequence(Timestamp="soon", ProbeToTrackerTransform="1 0 0")
    with pytest.raises(InputError, match="a: expected numbers in the field Timestamp"):
        frame_times_s(sequence, "filtered", "a")
    with pytest.raises(
        InputError, match="a: expected 16 numbers in ProbeToTrackerTransform of frame 0, found 3"
    ):
        frame_transform(sequence, "Probe", "Tracker", "a")
    bare = PlusSequence(sequence.pixels, ({}, {}, {}, {}))
    with pytest.raises(InputError, match="a: expected the field UnfilteredTimestamp of every frame"):
        frame_times_s(bare, "unfiltered", "a")
    assert not frame_transform(bare, "Probe", "Tracker", "a")[1].any()
