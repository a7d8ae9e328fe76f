"""The plain folder: what is written comes back, what a laboratory may write is read, each refusal names the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from sweeps import assert_same_sweep, known_sweep

from registration.errors import InputError
from registration.readers.folder import FolderReader, frame_names, write_folder


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
        ("frames.csv", "000002.png", "900002.png", r"900002\.png: expected a readable PNG"),
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
