"""Where the pixels of a PLUS recording lie: cropped frames, device sets against old calibrations, changing depth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plus_sequences import TIMES_S, text, tracked_sequence
from sweeps import CALIBRATION, world_T_ee

from registration import transforms as frames
from registration.errors import InputError
from registration.readers.chain.graph import TransformGraph
from registration.readers.folder import write_folder
from registration.readers.plus.config import device_set_xml
from registration.readers.plus.fields import write_sequence
from registration.readers.plus.reader import PlusReader
from registration.readers.plus.sequence import PlusSequence
from registration.readers.plus.writer import write_plus
from registration.sweep import TrackedSweep
from registration.synchronisation import synchronise

PIXEL = np.array([3.0, 2.0, 0.0])
WORLD_A_PIXEL = world_T_ee(TIMES_S) @ CALIBRATION.probe_A_pixel


def read(folder: Path, sequence: PlusSequence, **settings: object) -> TrackedSweep:
    write_sequence(folder / "a.igs.mha", sequence)
    return PlusReader(**settings)(folder / "a.igs.mha")  # type: ignore[arg-type]


def device_set(folder: Path, **transforms: np.ndarray) -> str:
    edges = {tuple(name.split("_to_")): matrix for name, matrix in transforms.items()}
    (folder / "set.xml").write_text(device_set_xml(TransformGraph(edges)))  # type: ignore[arg-type]
    return str(folder / "set.xml")


def with_fields(sequence: PlusSequence, name: str, matrices: list[np.ndarray], **status: str) -> PlusSequence:
    fields = [
        {**frame, name: text(matrix), **status}
        for frame, matrix in zip(sequence.frame_fields, matrices, strict=True)
    ]
    return PlusSequence(sequence.pixels, tuple(fields))


def places_mm(sweep: TrackedSweep, pixels: np.ndarray) -> np.ndarray:
    return np.stack([frames.apply(matrix, pixels) for matrix in synchronise(sweep, 1.0).world_A_pixel])


def test_a_cropped_frame_lies_where_its_pixels_lay_before(tmp_path: Path) -> None:
    crop = frames.translation((-335.0, -285.0, 0.0))
    sweep = read(tmp_path, tracked_sequence(ImageToCroppedImageTransform=text(crop)))
    expected = np.stack([frames.apply(matrix, PIXEL[None] + [335, 285, 0]) for matrix in WORLD_A_PIXEL])
    np.testing.assert_allclose(places_mm(sweep, PIXEL[None]), expected, atol=1e-9)
    assert sweep.image_A_pixel is None
    assert sweep.notes == ()


def test_a_crop_that_scales(tmp_path: Path) -> None:
    # Half the size, after 20 columns and 10 rows were cut off.
    crop = np.diag([0.5, 0.5, 1.0, 1.0]) @ frames.translation((-20.0, -10.0, 0.0))
    sweep = read(tmp_path, tracked_sequence(ImageToCroppedImageTransform=text(crop)))
    expected = np.stack(
        [frames.apply(matrix, PIXEL[None] * [2, 2, 1] + [20, 10, 0]) for matrix in WORLD_A_PIXEL]
    )
    np.testing.assert_allclose(places_mm(sweep, PIXEL[None]), expected, atol=1e-9)
    np.testing.assert_allclose(sweep.calibration.spacing_mm, 2 * np.array(CALIBRATION.spacing_mm))


def test_a_crop_that_changes_from_frame_to_frame(tmp_path: Path) -> None:
    offsets = [(-10.0, -4.0, 0.0), (-11.0, -4.0, 0.0), (-10.0, -9.5, 0.0), (-10.0, -4.0, 0.0)]
    crops = [frames.translation(offset) for offset in offsets]
    sequence = with_fields(tracked_sequence(), "ImageToCroppedImageTransform", crops)
    sweep = read(tmp_path, sequence)
    expected = np.stack(
        [
            frames.apply(matrix, PIXEL[None] - np.array(offset))
            for matrix, offset in zip(WORLD_A_PIXEL, offsets, strict=True)
        ]
    )
    np.testing.assert_allclose(places_mm(sweep, PIXEL[None]), expected, atol=1e-9)
    # The poses themselves are those of the tracker.
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(TIMES_S), atol=1e-9)
    write_plus(tmp_path / "again.igs.nrrd", sweep, max_gap_s=1.0)
    again = PlusReader()(tmp_path / "again.igs.nrrd")
    np.testing.assert_allclose(places_mm(again, PIXEL[None]), expected, atol=1e-6)
    with pytest.raises(
        InputError, match="sweep: expected one calibration for all frames to write a plain folder"
    ):
        write_folder(tmp_path / "folder", sweep)


def test_a_frame_with_an_invalid_crop_is_dropped_where_crops_change(tmp_path: Path) -> None:
    crops = [frames.translation((-float(index), 0.0, 0.0)) for index in range(4)]
    sequence = with_fields(tracked_sequence(), "ImageToCroppedImageTransform", crops)
    fields = [dict(frame) for frame in sequence.frame_fields]
    fields[1]["ImageToCroppedImageTransformStatus"] = "INVALID"
    sweep = read(tmp_path, PlusSequence(sequence.pixels, tuple(fields)))
    assert sweep.dropped == {"ImageToCroppedImageTransform INVALID": 1}
    expected = np.stack(
        [frames.apply(WORLD_A_PIXEL[index], PIXEL[None] + [index, 0, 0]) for index in (0, 2, 3)]
    )
    np.testing.assert_allclose(places_mm(sweep, PIXEL[None]), expected, atol=1e-9)


def test_a_depth_that_changes_during_the_recording(tmp_path: Path) -> None:
    deeper = CALIBRATION.probe_A_pixel @ np.diag([1.5, 1.5, 1.5, 1.0])
    calibrations = [CALIBRATION.probe_A_pixel] * 2 + [deeper] * 2
    sweep = read(tmp_path, with_fields(tracked_sequence(), "ImageToProbeTransform", calibrations))
    expected = np.stack(
        [
            frames.apply(pose @ calibration, PIXEL[None])
            for pose, calibration in zip(world_T_ee(TIMES_S), calibrations, strict=True)
        ]
    )
    np.testing.assert_allclose(places_mm(sweep, PIXEL[None]), expected, atol=1e-9)


def test_a_device_set_comes_before_an_old_calibration_in_the_file(tmp_path: Path) -> None:
    # Through two links, as PLUS's device sets have it; the file's own chain is shorter, and 12 mm off.
    moved = frames.translation((0.0, 0.0, 12.0)) @ CALIBRATION.probe_A_pixel
    scale = np.diag([0.5, 0.5, 0.5, 1.0])
    given = device_set(
        tmp_path,
        Image_to_Origin=scale,
        Origin_to_Probe=moved @ np.linalg.inv(scale),
        Phantom_to_Reference=np.eye(4),
    )
    sweep = read(tmp_path, tracked_sequence(), device_set=given)
    np.testing.assert_allclose(sweep.calibration.probe_A_pixel, moved, atol=1e-9)
    assert sweep.notes == (
        "a.igs.mha: its calibrations contradict each other: ImageToOrigin (device set), OriginToProbe (device set) was "
        "taken; ImageToProbe would put the image's corners up to 12.0 mm elsewhere.",
    )


def test_a_device_set_that_says_the_same_is_no_contradiction(tmp_path: Path) -> None:
    given = device_set(tmp_path, Image_to_Probe=np.round(CALIBRATION.probe_A_pixel, 3))
    assert read(tmp_path, tracked_sequence(), device_set=given).notes == ()


def test_a_device_set_that_leads_nowhere_is_told(tmp_path: Path) -> None:
    given = device_set(tmp_path, Image_to_TransducerOrigin=np.diag([0.1, 0.1, 0.1, 1.0]))
    sweep = read(tmp_path, tracked_sequence(), device_set=given)
    np.testing.assert_array_equal(sweep.calibration.probe_A_pixel, CALIBRATION.probe_A_pixel)
    assert sweep.notes == (
        "a.igs.mha: the device set (ImageToTransducerOrigin) leads to no calibration: ImageToProbe of the recording "
        "was taken.",
    )


def test_a_device_set_and_a_crop_together(tmp_path: Path) -> None:
    crop = frames.translation((-335.0, -285.0, 0.0))
    moved = frames.translation((5.0, 0.0, 0.0)) @ CALIBRATION.probe_A_pixel
    sweep = read(
        tmp_path,
        tracked_sequence(ImageToCroppedImageTransform=text(crop)),
        device_set=device_set(tmp_path, Image_to_Probe=moved),
    )
    np.testing.assert_allclose(sweep.calibration.probe_A_pixel, moved @ np.linalg.inv(crop), atol=1e-9)
    assert "up to 5.0 mm" in sweep.notes[0]
    # A calibration of the cropped image itself is one of the pixels that the file holds.
    sweep = read(
        tmp_path,
        tracked_sequence(ImageToCroppedImageTransform=text(crop)),
        device_set=device_set(tmp_path, CroppedImage_to_Probe=moved),
    )
    np.testing.assert_allclose(sweep.calibration.probe_A_pixel, moved, atol=1e-9)


def test_poses_that_contradict_each_other_are_told(tmp_path: Path) -> None:
    # ProbeToReference as PLUS computed it when the reference stood 7 mm elsewhere.
    old = [frames.translation((7.0, 0.0, 0.0)) @ pose for pose in world_T_ee(TIMES_S)]
    sweep = read(tmp_path, with_fields(tracked_sequence(), "ProbeToReferenceTransform", old))
    assert "poses contradict each other" in sweep.notes[0]
    assert "up to 7.0 mm and 0.0 degrees" in sweep.notes[0]
    same = with_fields(tracked_sequence(), "ProbeToReferenceTransform", list(world_T_ee(TIMES_S)))
    assert read(tmp_path, same).notes == ()


def test_a_broken_transform_outside_the_chain_does_not_matter(tmp_path: Path) -> None:
    sweep = read(tmp_path, tracked_sequence(StylusToTrackerTransform=text(np.zeros((4, 4)))))
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(TIMES_S), atol=1e-9)


@pytest.mark.parametrize("number", ["nan", "inf", "0"])
def test_a_frame_whose_pose_is_no_transform_is_dropped_and_counted(tmp_path: Path, number: str) -> None:
    sequence = tracked_sequence()
    fields = [dict(frame) for frame in sequence.frame_fields]
    fields[2]["ProbeToTrackerTransform"] = " ".join([number] * 16)
    sweep = read(tmp_path, PlusSequence(sequence.pixels, tuple(fields)))
    assert sweep.dropped == {"ProbeToTrackerTransform INVALID": 1}


def test_frames_with_to_in_their_names(tmp_path: Path) -> None:
    sequence = tracked_sequence()
    renamed = tuple(
        {
            key.replace("Probe", "TestTool").replace("Reference", "Torso"): value
            for key, value in frame.items()
        }
        for frame in sequence.frame_fields
    )
    sweep = read(tmp_path, PlusSequence(sequence.pixels, renamed), ee="TestTool", world="Torso")
    np.testing.assert_allclose(sweep.world_T_ee, world_T_ee(TIMES_S), atol=1e-9)
    np.testing.assert_allclose(sweep.calibration.probe_A_pixel, CALIBRATION.probe_A_pixel)
    unclear = tuple({**frame, "HandToEyeToHeadTransform": text(np.eye(4))} for frame in sequence.frame_fields)
    with pytest.raises(
        InputError, match=r"found ProbeToTracker, .* \(HandToEyeToHead could link several pairs of frames\)"
    ):
        read(tmp_path, PlusSequence(sequence.pixels, unclear), world="World")
    hand = read(
        tmp_path, PlusSequence(sequence.pixels, unclear), ee="HandToEye", world="Head", uncalibrated=True
    )
    np.testing.assert_array_equal(hand.world_T_ee, np.tile(np.eye(4), (4, 1, 1)))


def test_the_cropped_nwire_phantom_of_plus(real_data: Path) -> None:
    plus = real_data / "plus"
    wires = PlusReader(
        device_set=str(plus / "PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml")
    )
    cropped, whole = (wires(plus / f"NwirePhantomFreehand{name}.igs.mha") for name in ("Cropped", ""))
    first_px = np.array([[0.0, 0.0, 0.0]])
    np.testing.assert_allclose(places_mm(cropped, first_px)[0, 0], [5.77, -114.93, -36.93], atol=5e-3)
    np.testing.assert_array_equal(cropped.images[0], whole.images[0, 285 : 285 + 150, 335 : 335 + 200])
    np.testing.assert_allclose(
        places_mm(cropped, first_px),
        places_mm(whole, np.array([[335.0, 285.0, 0.0]]))[: len(cropped.images)],
        atol=1e-9,
    )


@pytest.mark.parametrize(("name", "count"), [("SyntheticTrackerBuffer20", 20), ("Prostate10_tracker", 10)])
def test_recordings_of_a_tool_without_pixels(real_data: Path, name: str, count: int) -> None:
    path = real_data / "plus" / f"{name}.igs.mha"
    sweep = PlusReader(ee="Tool", world="Tracker")(path)
    assert (len(sweep.world_T_ee), len(sweep.images)) == (count, 0)
    if name == "SyntheticTrackerBuffer20":
        np.testing.assert_array_equal(sweep.world_T_ee[:2, :3, 3], [[10, 20, 30], [10, 20, 31]])
    with pytest.raises(InputError, match="expected a chain of known transforms, found ToolToTracker"):
        PlusReader()(path)
