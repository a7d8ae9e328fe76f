"""PLUS sequences: round trips, status, chains, orientations, and the toolkit's own files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sweeps import CALIBRATION, assert_same_sweep, known_sweep, world_T_ee

from registration import frames
from registration.errors import InputError
from registration.readers.plus import PlusReader
from registration.readers.plus_fields import (
    frame_times_s,
    frame_transform,
    read_sequence,
    transform_names,
    write_sequence,
)
from registration.readers.plus_writer import write_plus
from registration.readers.sequence import PlusSequence
from registration.sweep import TrackedSweep
from registration.synchronisation import synchronise

FORMATS = ["sweep.igs.mha", "sweep.igs.nrrd"]
TIMES_S = np.array([1.0, 1.1, 1.2, 1.3])


def text(matrix: np.ndarray) -> str:
    return " ".join(repr(float(number)) for number in matrix.reshape(-1))


def tracked_sequence(
    statuses: tuple[str, ...] = ("OK", "OK", "OK", "OK"), **every_frame: str
) -> PlusSequence:
    """Four frames whose Probe and Reference are tracked; Reference stands obliquely in the tracker's frame."""
    tracker_T_reference = world_T_ee(np.array([7.0]))[0]
    pixels = np.random.default_rng(1).integers(0, 256, (4, 3, 5)).astype(np.uint8)
    fields = tuple(
        {
            "ProbeToTrackerTransform": text(tracker_T_reference @ pose),
            "ProbeToTrackerTransformStatus": status,
            "ReferenceToTrackerTransform": text(tracker_T_reference),
            "ReferenceToTrackerTransformStatus": "OK",
            "ImageToProbeTransform": text(CALIBRATION.probe_A_pixel),
            "Timestamp": repr(float(time_s)),
            "UnfilteredTimestamp": repr(float(time_s) + 0.004),
            "ImageStatus": "OK",
            **every_frame,
        }
        for time_s, pose, status in zip(TIMES_S, world_T_ee(TIMES_S), statuses, strict=True)
    )
    return PlusSequence(pixels, fields)


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


def test_chain_goes_through_the_tracked_reference(tmp_path: Path) -> None:
    write_sequence(tmp_path / "a.igs.mha", tracked_sequence())
    sweep = PlusReader()(tmp_path / "a.igs.mha")
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(TIMES_S), atol=1e-9)
    np.testing.assert_allclose(sweep.calibration.probe_A_pixel, CALIBRATION.probe_A_pixel)
    poses_only = PlusSequence(np.zeros((4, 0, 0), np.uint8), tracked_sequence().frame_fields)
    write_sequence(tmp_path / "b.igs.mha", poses_only)
    backwards = PlusReader(world="Probe", ee="Reference")(tmp_path / "b.igs.mha")
    np.testing.assert_allclose(
        backwards.world_T_ee @ sweep.world_T_ee, np.tile(np.eye(4), (4, 1, 1)), atol=1e-9
    )


@pytest.mark.parametrize(("clock", "first_s"), [("filtered", 1.0), ("unfiltered", 1.004)])
def test_either_clock_can_be_taken(tmp_path: Path, clock: str, first_s: float) -> None:
    write_sequence(tmp_path / "a.igs.mha", tracked_sequence())
    sweep = PlusReader(clock=clock)(tmp_path / "a.igs.mha")
    assert sweep.image_times_s[0] == pytest.approx(first_s, abs=1e-12)
    assert sweep.pose_times_s[0] == pytest.approx(first_s, abs=1e-12)


def test_invalid_pose_and_invalid_image_are_dropped_and_counted(tmp_path: Path) -> None:
    sequence = tracked_sequence(("OK", "INVALID", "OK", "OK"))
    fields = [dict(frame) for frame in sequence.frame_fields]
    fields[3]["ImageStatus"] = "INVALID"
    write_sequence(tmp_path / "a.igs.mha", PlusSequence(sequence.pixels, tuple(fields)))
    sweep = PlusReader()(tmp_path / "a.igs.mha")
    assert sweep.dropped == {"ProbeToTrackerTransform INVALID": 1, "ImageStatus INVALID": 1}
    np.testing.assert_array_equal(sweep.images, sequence.pixels[[0, 2]])
    assert sweep.pose_times_s.tolist() == [1.0, 1.2, 1.3]
    assert synchronise(sweep, 1.0).dropped == sweep.dropped


def test_tracker_may_lie_in_a_second_file(tmp_path: Path) -> None:
    tracked = tracked_sequence()
    write_sequence(
        tmp_path / "tracker.igs.mha", PlusSequence(np.zeros((4, 0, 0), np.uint8), tracked.frame_fields)
    )
    video_fields = tuple(
        {"Timestamp": f"{1.04 + 0.1 * index}", "ImageToProbeTransform": text(CALIBRATION.probe_A_pixel)}
        for index in range(4)
    )
    write_sequence(tmp_path / "video.igs.mha", PlusSequence(tracked.pixels, video_fields))
    sweep = PlusReader(tracker=str(tmp_path / "tracker.igs.mha"))(tmp_path / "video.igs.mha")
    np.testing.assert_array_equal(sweep.images, tracked.pixels)
    np.testing.assert_allclose(sweep.image_times_s, [1.04, 1.14, 1.24, 1.34])
    assert synchronise(sweep, 0.2).kept.tolist() == [0, 1, 2]


def test_colour_becomes_grey_by_luma(tmp_path: Path) -> None:
    sequence = tracked_sequence()
    colour = np.zeros((4, 3, 5, 3), np.uint8)
    colour[0] = (100, 50, 200)
    write_sequence(tmp_path / "a.igs.mha", PlusSequence(colour, sequence.frame_fields))
    assert (
        PlusReader()(tmp_path / "a.igs.mha").images[0, 0, 0] == 82
    )  # 0.299 * 100 + 0.587 * 50 + 0.114 * 200


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"ee": "Stylus"}, r"a\.igs\.mha: transform StylusToReference: expected a chain of .* found Probe"),
        ({"image": "Picture"}, r"a\.igs\.mha: no calibration \(set device_set\)"),
        ({"rigid_tolerance": 1e-17}, r"a\.igs\.mha: ProbeToReference: expected orthonormal rotations"),
    ],
)  # fmt: skip
def test_what_the_file_does_not_have_is_refused(
    tmp_path: Path, settings: dict[str, object], message: str
) -> None:
    write_sequence(tmp_path / "a.igs.mha", tracked_sequence())
    with pytest.raises(InputError, match=message):
        PlusReader(**settings)(tmp_path / "a.igs.mha")


def test_all_invalid_poses_are_refused(tmp_path: Path) -> None:
    write_sequence(tmp_path / "a.igs.mha", tracked_sequence(("INVALID",) * 4))
    with pytest.raises(InputError, match="at least one frame with a valid ProbeToReference, found none"):
        PlusReader()(tmp_path / "a.igs.mha")


def test_left_handed_pose_is_refused(tmp_path: Path) -> None:
    mirrored = text(np.diag([1.0, 1.0, -1.0, 1.0]))
    write_sequence(tmp_path / "a.igs.mha", tracked_sequence(ReferenceToTrackerTransform=mirrored))
    with pytest.raises(InputError, match="expected a right-handed rotation"):
        PlusReader()(tmp_path / "a.igs.mha")


def test_times_that_run_backwards_are_refused(tmp_path: Path) -> None:
    sequence = tracked_sequence()
    fields = [dict(frame) for frame in sequence.frame_fields]
    fields[2]["Timestamp"] = "1.05"
    write_sequence(tmp_path / "a.igs.mha", PlusSequence(sequence.pixels, tuple(fields)))
    with pytest.raises(InputError, match=r"in the order of their times, found 1\.050000 s after 1\.100000 s"):
        PlusReader()(tmp_path / "a.igs.mha")


@pytest.mark.parametrize("settings", [{"clock": "wall"}, {"rigid_tolerance": 0.0}])
def test_settings_are_checked(settings: dict[str, object]) -> None:
    with pytest.raises(InputError, match=next(iter(settings))):
        PlusReader(**settings)


def test_spine_phantom_of_plus(real_data: Path) -> None:
    plus = real_data / "plus"
    reader = PlusReader(device_set=str(plus / "PlusDeviceSet_SpinePhantomFreehandReconstructionOnly.xml"))
    sweep = reader(plus / "SpinePhantomFreehand.igs.mha")
    assert sweep.images.shape == (21, 616, 820)
    assert sweep.dropped == {}
    np.testing.assert_allclose(sweep.calibration.probe_A_pixel[:3, 3], [15.3978, 49.5705, -8.63446])
    probe, reference = (
        frame_transform(read_sequence(plus / "SpinePhantomFreehand.igs.mha"), body, "Tracker", "")[0]
        for body in ("Probe", "Reference")
    )
    np.testing.assert_allclose(sweep.world_T_ee, np.linalg.inv(reference) @ probe, atol=2e-3)


def test_invalid_stylus_of_the_nwire_phantom(real_data: Path) -> None:
    path = real_data / "plus" / "NwirePhantomFreehand.igs.mha"
    sequence = read_sequence(path)
    assert sequence.pixels.shape == (97, 616, 820)
    assert not frame_transform(sequence, "Stylus", "Tracker", "")[1].any()
    assert frame_transform(sequence, "Probe", "Tracker", "")[1].all()
    with pytest.raises(InputError, match=r"NwirePhantomFreehand.*valid StylusToReference, found none"):
        PlusReader(ee="Stylus")(path)


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
    tracker_T_probe = frames.nearest_rigid(matrices[valid])
    # The toolkit's own test of this file samples at five times the recorded rate.
    between_s = np.linspace(times_s[valid][0], times_s[valid][-1], 5 * len(times_s))
    poses = frames.interpolate(between_s, times_s[valid], tracker_T_probe)
    step = frames.invert_rigid(poses[:-1]) @ poses[1:]
    assert np.linalg.norm(step[:, :3, 3], axis=1).max() < 0.5
    assert frames.rotation_angle_deg(step).max() < 1.0
    # The recorded times come out as the recorded poses.
    np.testing.assert_allclose(
        frames.interpolate(times_s[valid], times_s[valid], tracker_T_probe), tracker_T_probe
    )
