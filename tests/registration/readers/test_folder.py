"""The plain folder: what is written comes back, what a laboratory may write is read, each refusal names the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from sweeps import assert_same_sweep, known_sweep

from registration.errors import InputError
from registration.readers.folder import UNLISTED, FolderReader, frame_names, write_folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A sweep folder as this project writes it."""
    write_folder(tmp_path / "sweep", known_sweep())
    return tmp_path / "sweep"


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def minimal(path: Path, settings: str, poses: str, frame_count: int = 2) -> Path:
    """A folder as a laboratory would write it by hand."""
    (path / "frames").mkdir(parents=True)
    for index in range(frame_count):
        Image.fromarray(np.full((4, 5), 40 * index, np.uint8)).save(path / "frames" / f"f{index}.png")
    (path / "sweep.yaml").write_text(settings)
    (path / "poses.csv").write_text(poses)
    return path


CALIBRATION_YAML = "probe_A_pixel: [[0.1, 0, 0, 1], [0, 0.2, 0, 2], [0, 0, 0.1, 3], [0, 0, 0, 1]]\n"
POSES = """timestamp_s,tx,ty,tz,qx,qy,qz,qw
0.5,100,20,-30,0,0,0,1
1.5,110,20,-30,0,0,0.7071067811865476,0.7071067811865476
"""


def test_written_sweep_comes_back_whole(folder: Path) -> None:
    assert_same_sweep(FolderReader()(folder), known_sweep())


def test_hand_written_folder_with_a_pose_for_each_frame(tmp_path: Path) -> None:
    sweep = FolderReader()(minimal(tmp_path / "lab", CALIBRATION_YAML, POSES))
    assert sweep.images[:, 0, 0].tolist() == [0, 40]
    assert sweep.image_times_s.tolist() == [0.5, 1.5]
    np.testing.assert_allclose(sweep.world_T_ee[1, :3, 3], [110, 20, -30])
    # A quarter turn about z brings x to y.
    np.testing.assert_allclose(sweep.world_T_ee[1, :3, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_array_equal(sweep.calibration.ee_T_probe, np.eye(4))


def test_frame_rate_gives_the_frames_times(tmp_path: Path) -> None:
    settings = CALIBRATION_YAML + "frame_rate_hz: 4\nfirst_frame_s: 0.6\n"
    sweep = FolderReader()(minimal(tmp_path / "lab", settings, POSES, frame_count=3))
    np.testing.assert_allclose(sweep.image_times_s, [0.6, 0.85, 1.1])


def test_columns_may_stand_in_any_order_with_others_between(tmp_path: Path) -> None:
    poses = (
        "qw, qx, qy, qz, force, tz, ty, tx, timestamp_s\n1,0,0,0,9,-30,20,100,0.5\n1,0,0,0,9,-31,21,101,1.5\n"
    )
    sweep = FolderReader()(minimal(tmp_path / "lab", CALIBRATION_YAML, poses))
    np.testing.assert_allclose(sweep.world_T_ee[:, :3, 3], [[100, 20, -30], [101, 21, -31]])


def test_metres_are_converted_when_they_are_said(tmp_path: Path) -> None:
    settings = CALIBRATION_YAML + "units: m\nee_T_probe: [[1, 0, 0, 0.07], [0, 1, 0, 0], [0, 0, 1, -0.01]]\n"
    poses = POSES.replace("100,20,-30", "0.1,0.02,-0.03").replace("110,20,-30", "0.11,0.02,-0.03")
    sweep = FolderReader()(minimal(tmp_path / "lab", settings, poses))
    np.testing.assert_allclose(sweep.world_T_ee[1, :3, 3], [110, 20, -30])
    np.testing.assert_allclose(sweep.calibration.ee_T_probe[:3, 3], [70, 0, -10])
    np.testing.assert_allclose(sweep.calibration.probe_A_pixel[:3, 3], [1, 2, 3])


def test_other_orientation_is_turned_to_mf(folder: Path) -> None:
    edit(folder / "sweep.yaml", "orientation: MF", "orientation: UN")
    np.testing.assert_array_equal(FolderReader()(folder).images, known_sweep().images[:, ::-1, ::-1])


def test_repeated_row_is_left_out_but_its_frame_is_kept(tmp_path: Path) -> None:
    lines = POSES.splitlines()
    sweep = FolderReader()(
        minimal(tmp_path / "lab", CALIBRATION_YAML, "\n".join([*lines, lines[-1]]) + "\n", 3)
    )
    assert len(sweep.images) == 3
    assert len(sweep.world_T_ee) == 2


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("sweep.yaml", "probe_A_pixel", "probe", r"sweep\.yaml: expected the key probe_A_pixel, found"),
        ("sweep.yaml", "units: mm", "units: inch", r"sweep\.yaml: expected units mm or m, found 'inch'"),
        ("sweep.yaml", "orientation: MF", "orientation: QX", r"sweep\.yaml: expected an image orientation"),
        ("sweep.yaml", "units: mm", "units: [mm", r"sweep\.yaml: expected YAML"),
        (
            "poses.csv",
            "timestamp_s,tx",
            "time,tx",
            r"poses\.csv: expected the columns timestamp_s, .* found time",
        ),
        ("frames.csv", "000002.png", "900002.png", r"900002\.png: expected a file, received nothing there"),
        ("frames.csv", "000002.png,", "000002.png,x", r"frames\.csv: expected numbers for timestamp_s"),
    ],
)
def test_refusals_name_the_file(folder: Path, file: str, old: str, new: str, message: str) -> None:
    edit(folder / file, old, new)
    with pytest.raises(InputError, match=message):
        FolderReader()(folder)


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (POSES.replace("100,20", "x,20"), "expected numbers"),
        (POSES.replace("100,20", "nan,20"), "expected finite numbers, found NaN or infinity in line 2"),
        (
            POSES.replace("0,0,0,1\n", "0,0,0,2\n"),
            "expected unit quaternions, found one of length 2 in line 2",
        ),
        (
            POSES.replace("0.5,100", "2.5,100"),
            r"in the order of their times, found 1\.500000 s after 2\.500000 s",
        ),
        (POSES.replace("0.5,100", "1.5,100"), "in the order of their times"),
        (POSES.splitlines()[0] + "\n", "expected at least one pose, found none"),
        (
            POSES.replace("100,20,-30", "0.1,0.02,-0.03").replace("110,20,-30", "0.1,0.02,-0.04"),
            "were they metres",
        ),
    ],
)
def test_bad_poses_are_refused(tmp_path: Path, poses: str, message: str) -> None:
    path = minimal(tmp_path / "lab", CALIBRATION_YAML, poses)
    with pytest.raises(InputError, match=rf"poses\.csv: {message}|poses\.csv: .*{message}"):
        FolderReader()(path)


def test_calibration_in_metres_is_refused(tmp_path: Path) -> None:
    settings = "probe_A_pixel: [[0.0001, 0, 0, 0], [0, 0.0001, 0, 0], [0, 0, 0.0001, 0]]\n"
    with pytest.raises(
        InputError, match=r"sweep\.yaml: expected probe_A_pixel in millimetres, found pixels of 0\.0001"
    ):
        FolderReader()(minimal(tmp_path / "lab", settings, POSES))


@pytest.mark.parametrize(
    "settings, message",
    [
        (
            "units: m\nee_T_probe: 5\n",
            r"sweep\.yaml: expected ee_T_probe as four rows of four numbers, found shape",
        ),
        ("units: [m]\n", r"sweep\.yaml: expected units mm or m, found \['m'\]"),
    ],
)
def test_settings_of_another_shape_are_refused(tmp_path: Path, settings: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        FolderReader()(minimal(tmp_path / "lab", CALIBRATION_YAML + settings, POSES))


def test_left_handed_probe_is_refused(tmp_path: Path) -> None:
    settings = CALIBRATION_YAML + "ee_T_probe: [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]\n"
    with pytest.raises(InputError, match=r"sweep\.yaml: ee_T_probe: expected a right-handed rotation"):
        FolderReader()(minimal(tmp_path / "lab", settings, POSES))


def test_images_of_different_size_are_refused(folder: Path) -> None:
    Image.fromarray(np.zeros((8, 12), np.uint8)).save(folder / "frames" / "000003.png")
    with pytest.raises(
        InputError, match=r"000003\.png: expected the size of 000000\.png, 11x8 pixels, found 12x8"
    ):
        FolderReader()(folder)


def test_truncated_image_is_refused(folder: Path) -> None:
    file = folder / "frames" / "000001.png"
    file.write_bytes(file.read_bytes()[:60])
    with pytest.raises(InputError, match=r"000001\.png: expected a readable PNG image"):
        FolderReader()(folder)


def test_frames_without_times_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found 3 frames and 2 poses"):
        FolderReader()(minimal(tmp_path / "lab", CALIBRATION_YAML, POSES, frame_count=3))


def test_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent: expected a folder with frames/"):
        FolderReader()(tmp_path / "absent")


@pytest.mark.parametrize("suffix", [".png", ".PNG", ".bmp", ".tif"])
def test_frames_get_the_poses_of_their_numbers(tmp_path: Path, suffix: str) -> None:
    """24 frames without leading zeros: frame 10 gets the tenth pose and not the third."""
    path = minimal(tmp_path / "lab", CALIBRATION_YAML, "", frame_count=0)
    rows = [f"{index},{100 + 5 * index},20,-30,0,0,0,1" for index in range(24)]
    (path / "poses.csv").write_text("\n".join([POSES.splitlines()[0], *rows]) + "\n")
    for index in range(24):
        Image.fromarray(np.full((4, 5), 10 * index, np.uint8)).save(
            path / "frames" / f"frame_{index}{suffix}"
        )
    (path / "frames" / f"._frame_3{suffix}").write_bytes(b"of the system's own")
    (path / "frames" / ".DS_Store").write_bytes(b"of the system's own")
    sweep = FolderReader()(path)
    assert sweep.images[:, 0, 0].tolist() == [10 * index for index in range(24)]
    np.testing.assert_array_equal(sweep.image_times_s, np.arange(24))
    assert frame_names(path) == tuple(f"frame_{index}" for index in range(24))


def test_mixed_padding_is_refused(tmp_path: Path) -> None:
    path = minimal(tmp_path / "lab", CALIBRATION_YAML, POSES)
    (path / "frames" / "f0.png").rename(path / "frames" / "f001.png")
    with pytest.raises(
        InputError, match="frames: expected names that differ in more than zeros and case, found f001"
    ):
        FolderReader()(path)


def test_frames_of_another_kind_are_not_a_sweep_without_frames(tmp_path: Path) -> None:
    path = minimal(tmp_path / "lab", CALIBRATION_YAML + "frame_rate_hz: 4\n", POSES, frame_count=0)
    (path / "frames" / "f0.dcm").write_bytes(b"")
    with pytest.raises(InputError, match=r"frames: expected pictures \(.*found f0\.dcm"):
        FolderReader()(path)


def test_images_that_the_table_does_not_name_are_counted(folder: Path) -> None:
    rows = (folder / "frames.csv").read_text().splitlines()
    (folder / "frames.csv").write_text("\n".join([*rows[:3], *rows[4:]]) + "\n")
    assert FolderReader()(folder).dropped == {UNLISTED: 1}
    (folder / "frames.csv").write_text("\n".join([*rows, rows[1]]) + "\n")
    with pytest.raises(InputError, match=r"frames\.csv: expected each file once, found 000000\.png twice"):
        FolderReader()(folder)


def test_frames_named_by_windows_with_their_folder(folder: Path) -> None:
    rows = (folder / "frames.csv").read_text().splitlines()
    (folder / "frames.csv").write_text("\n".join([rows[0], *(f"frames\\{row}" for row in rows[1:])]) + "\n")
    assert_same_sweep(FolderReader()(folder), known_sweep())


@pytest.mark.parametrize(
    "line, message",
    [
        ("0,5,100,0,20,0,-30,0,0,0,0,0,0,0,1,0", "expected 8 fields in every row, found 16 in row 2"),
        ("0.5,100,20,-30,0,0,0", "expected 8 fields in every row, found 7 in row 2"),
        ("0.5,1_00,20,-30,0,0,0,1", "expected numbers, found .*1_00"),
    ],
)
def test_rows_that_would_go_to_the_wrong_columns_are_refused(tmp_path: Path, line: str, message: str) -> None:
    path = minimal(tmp_path / "lab", CALIBRATION_YAML, "\n".join([POSES.splitlines()[0], line]) + "\n", 1)
    with pytest.raises(InputError, match=message):
        FolderReader()(path)


def test_a_column_given_twice_is_refused(tmp_path: Path) -> None:
    poses = "tx," + POSES.replace("0.5,100", "0,0.5,100").replace("1.5,110", "0,1.5,110")
    with pytest.raises(InputError, match=r"expected the columns timestamp_s, .* found tx, timestamp_s, tx"):
        FolderReader()(minimal(tmp_path / "lab", CALIBRATION_YAML, poses))


def test_byte_order_marks_and_trailing_commas(tmp_path: Path) -> None:
    path = minimal(tmp_path / "lab", "\ufeff" + CALIBRATION_YAML, "\ufeff" + POSES.replace("\n", ",\n"))
    np.testing.assert_allclose(FolderReader()(path).world_T_ee[1, :3, 3], [110, 20, -30])


def test_quaternions_slightly_off_unit_length_are_scaled(tmp_path: Path) -> None:
    poses = POSES.replace("0,0,0,1\n", "0,0,0,1.003\n")
    sweep = FolderReader()(minimal(tmp_path / "lab", CALIBRATION_YAML, poses))
    np.testing.assert_allclose(sweep.world_T_ee[0, :3, :3], np.eye(3), atol=1e-12)


@pytest.mark.parametrize("origin", [0.0, 40.0])
def test_metres_far_from_the_origin_are_refused(tmp_path: Path, origin: float) -> None:
    poses = POSES.replace("100,20,-30", f"{origin + 0.4},0.02,-0.03").replace(
        "110,20,-30", f"{origin + 0.5},0.02,0"
    )
    with pytest.raises(InputError, match=r"poses\.csv: expected positions in mm, .*say units: m"):
        FolderReader()(minimal(tmp_path / "lab", CALIBRATION_YAML, poses))
    sweep = FolderReader()(minimal(tmp_path / "said", CALIBRATION_YAML + "units: m\n", poses))
    np.testing.assert_allclose(np.ptp(sweep.world_T_ee[:, 0, 3]), 100)


def test_a_lever_in_metres_is_refused(tmp_path: Path) -> None:
    settings = CALIBRATION_YAML + "ee_T_probe: [[1, 0, 0, 0.07], [0, 1, 0, 0], [0, 0, 1, -0.01]]\n"
    with pytest.raises(
        InputError, match=r"sweep\.yaml: expected ee_T_probe in millimetres, found a lever of 0\.0707"
    ):
        FolderReader()(minimal(tmp_path / "lab", settings, POSES))


def test_writing_does_not_touch_a_folder_with_content(folder: Path) -> None:
    before = sorted(path.name for path in folder.iterdir())
    with pytest.raises(InputError, match="expected a folder that does not exist yet or is empty"):
        write_folder(folder, known_sweep(frame_count=2))
    assert sorted(path.name for path in folder.iterdir()) == before
    assert len(list((folder / "frames").iterdir())) == 6


def test_frames_have_names_in_a_plain_folder_only(tmp_path: Path, folder: Path) -> None:
    assert frame_names(folder) == tuple(f"{index:06d}" for index in range(6))
    assert frame_names(folder.parent) == frame_names(folder)
    rows = (folder / "frames.csv").read_text().splitlines()
    (folder / "frames.csv").write_text("\n".join([rows[0], *rows[:0:-1]]))
    assert frame_names(folder) == tuple(f"{index:06d}" for index in reversed(range(6)))
    (folder / "frames.csv").unlink()
    assert frame_names(folder) == tuple(f"{index:06d}" for index in range(6))
    assert frame_names(tmp_path / "a.igs.mha") is None


@pytest.mark.parametrize(("key", "meant"), [("unit: m", "units"), ("frame_rate: 20", "frame_rate_hz")])
def test_a_key_that_is_nearly_ours_is_a_slip(tmp_path: Path, key: str, meant: str) -> None:
    with pytest.raises(InputError, match=rf"sweep\.yaml: expected keys such as .*did you mean {meant}\?"):
        FolderReader()(minimal(tmp_path / "lab", f"{CALIBRATION_YAML}{key}\n", POSES))


def test_keys_of_other_programs_may_stand_there_too(tmp_path: Path) -> None:
    assert (
        len(FolderReader()(minimal(tmp_path / "lab", CALIBRATION_YAML + "operator: A. B.\n", POSES)).images)
        == 2
    )


def test_a_stated_unit_that_makes_a_sweep_of_a_kilometre_is_refused(tmp_path: Path) -> None:
    poses = POSES.replace("110,20", "1100,20")
    with pytest.raises(
        InputError, match=r"poses\.csv: expected poses within 20 m, found .* by units: m in sweep\.yaml"
    ):
        FolderReader()(minimal(tmp_path / "lab", CALIBRATION_YAML + "units: m\n", poses))
