"""Sweeps from PLUS sequences: status, chains, clocks, and the toolkit's own files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plus_sequences import TIMES_S, text, tracked_sequence
from sweeps import CALIBRATION, world_T_ee

from registration.errors import InputError
from registration.readers.plus.fields import frame_transform, read_sequence, write_sequence
from registration.readers.plus.reader import PlusReader
from registration.readers.plus.sequence import PlusSequence
from registration.synchronisation import synchronise


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
        ({"image": "Picture"}, r"a\.igs\.mha: no calibration \(set device_set, or"),
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
