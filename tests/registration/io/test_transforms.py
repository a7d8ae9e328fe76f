"""Transforms through files: what ITK itself makes of them decides the direction."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import SimpleITK
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.io.transforms import read_transform, write_transform

POSE = transforms.from_rotation(Rotation.from_rotvec([0.4, 0.2, 2.0]), np.array([5.0, -300, 77]))
POINT = np.array([12.0, -7.0, 30.0])


@pytest.mark.parametrize("suffix", [".tfm", ".h5"])
def test_itk_maps_a_fixed_point_to_its_moving_one(tmp_path: Path, suffix: str) -> None:
    """The direction of a resampler: fixed to moving. Inverted, as 3D Slicer does on reading, it moves the model."""
    write_transform(tmp_path / f"pose{suffix}", POSE)
    transform = SimpleITK.ReadTransform(str(tmp_path / f"pose{suffix}"))
    fixed_point = transforms.apply(POSE, POINT)
    np.testing.assert_allclose(transform.TransformPoint(fixed_point.tolist()), POINT, atol=1e-9)
    np.testing.assert_allclose(transform.GetInverse().TransformPoint(POINT.tolist()), fixed_point, atol=1e-9)
    np.testing.assert_allclose(read_transform(tmp_path / f"pose{suffix}"), POSE, atol=1e-9)
    assert [path.name for path in tmp_path.iterdir()] == [f"pose{suffix}"]


def test_a_moving_image_resampled_by_the_file_lands_on_the_fixed_one(tmp_path: Path) -> None:
    """One bright voxel at a known moving point is found at the fixed point that the pose gives it."""
    pose = transforms.from_rotation(Rotation.from_euler("z", 90, degrees=True), np.array([20.0, 3, 1]))
    write_transform(tmp_path / "pose.tfm", pose)
    values = np.zeros((8, 16, 16), dtype=np.float32)
    values[2, 5, 9] = 1.0
    moving = SimpleITK.GetImageFromArray(values)
    fixed = SimpleITK.Image([32, 32, 16], SimpleITK.sitkFloat32)
    placed = SimpleITK.Resample(moving, fixed, SimpleITK.ReadTransform(str(tmp_path / "pose.tfm")))
    found = np.argwhere(SimpleITK.GetArrayFromImage(placed) > 0.5)
    np.testing.assert_array_equal(found[:, ::-1], transforms.apply(pose, np.array([[9.0, 5.0, 2.0]])).round())


def test_json_keeps_its_direction(tmp_path: Path) -> None:
    (tmp_path / "pose.json").write_text(json.dumps({"fixed_T_moving": POSE.tolist(), "rmse_mm": 1.0}))
    np.testing.assert_array_equal(read_transform(tmp_path / "pose.json"), POSE)


@pytest.mark.parametrize(
    "transform",
    [
        SimpleITK.VersorRigid3DTransform((0.0, 0.6, 0.0, 0.8), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)),
        SimpleITK.Euler3DTransform((10.0, -3.0, 2.0), 0.1, 0.2, 0.3, (4.0, 5.0, 6.0)),
        SimpleITK.TranslationTransform(3, (1.0, -2.0, 3.0)),
        SimpleITK.CompositeTransform(
            [
                SimpleITK.Euler3DTransform((1.0, 2.0, 3.0), 0.4, 0.5, 0.6),
                SimpleITK.TranslationTransform(3, (9.0, 8.0, 7.0)),
            ]
        ),
    ],
    ids=lambda transform: transform.GetName(),
)
@pytest.mark.parametrize("suffix", [".tfm", ".h5"])
def test_every_rigid_class_of_itk_is_read(
    tmp_path: Path, transform: SimpleITK.Transform, suffix: str
) -> None:
    """With a centre of rotation of its own, or made of several: where it takes a point is what counts."""
    SimpleITK.WriteTransform(transform, str(tmp_path / f"own{suffix}"))
    fixed_T_moving = read_transform(tmp_path / f"own{suffix}")
    moving_point = np.array(transform.TransformPoint(POINT.tolist()))
    np.testing.assert_allclose(transforms.apply(fixed_T_moving, moving_point), POINT, atol=1e-9)


@pytest.mark.parametrize(
    "name",
    ["AffineTransform_double_3_3", "MatrixOffsetTransformBase_double_3_3", "AffineTransform_float_3_3"],
)
@pytest.mark.parametrize("suffix", [".mat", ".txt"])
def test_affines_of_ants_turn_about_their_centre_and_map_fixed_to_moving(
    tmp_path: Path, name: str, suffix: str
) -> None:
    """What antsRegistration leaves as 0GenericAffine.mat: moving = R (fixed - centre) + centre + translation, LPS."""
    turn, shift, centre = POSE[:3, :3], np.array([5.0, -7, 20]), np.array([30.0, 40, -50])
    numbers = np.concatenate([turn.ravel(), shift])
    if suffix == ".mat":
        kind = np.float32 if "float" in name else np.float64
        values = {name: numbers[:, None].astype(kind), "fixed": centre[:, None].astype(kind)}
        scipy.io.savemat(tmp_path / "0GenericAffine.mat", values, format="4")
    else:
        text = f"Parameters: {' '.join(map(str, numbers))}\nFixedParameters: {' '.join(map(str, centre))}\n"
        head = f"#Insight Transform File V1.0\n#Transform 0\nTransform: {name}\n"
        (tmp_path / "0GenericAffine.txt").write_text(head + text)
    fixed_T_moving = read_transform(tmp_path / f"0GenericAffine{suffix}")
    moving_point = turn @ (POINT - centre) + centre + shift
    np.testing.assert_allclose(transforms.apply(fixed_T_moving, moving_point), POINT, atol=1e-4)


def test_a_mat_of_slicers_is_that_of_itk(tmp_path: Path) -> None:
    """3D Slicer saves a linear transform through ITK: the same numbers as in its .tfm."""
    write_transform(tmp_path / "pose.tfm", POSE)
    SimpleITK.WriteTransform(SimpleITK.ReadTransform(str(tmp_path / "pose.tfm")), str(tmp_path / "pose.mat"))
    np.testing.assert_allclose(read_transform(tmp_path / "pose.mat"), POSE, atol=1e-9)


@pytest.mark.parametrize("share", [0.05, 0.15, 0.4, 0.6, 0.98])
def test_a_mat_cut_short(tmp_path: Path, capfd: pytest.CaptureFixture[str], share: float) -> None:
    SimpleITK.WriteTransform(SimpleITK.AffineTransform(3), str(tmp_path / "pose.mat"))
    whole = (tmp_path / "pose.mat").read_bytes()
    (tmp_path / "cut.mat").write_bytes(whole[: int(share * len(whole))])
    assert "cut short" in refusal(tmp_path / "cut.mat")
    assert capfd.readouterr() == ("", "")


def test_other_files_called_mat(tmp_path: Path) -> None:
    """FSL's are text between voxels: taken for millimetres they would be a wrong pose."""
    np.savetxt(tmp_path / "fsl.mat", POSE)
    assert "FSL's matrices are between voxels" in refusal(tmp_path / "fsl.mat")
    scipy.io.savemat(tmp_path / "five.mat", {"T": POSE})
    assert "received variables of a later MATLAB" in refusal(tmp_path / "five.mat")
    scipy.io.savemat(tmp_path / "four.mat", {"T": POSE}, format="4")
    assert "expected a transform and its fixed parameters, received T" in refusal(tmp_path / "four.mat")
    (tmp_path / "none.mat").write_bytes(b"")
    assert "received no variable" in refusal(tmp_path / "none.mat")


def test_text_of_four_rows_is_the_pose_itself(tmp_path: Path) -> None:
    """Not inverted: p_fixed = M p_moving."""
    np.savetxt(tmp_path / "a.txt", POSE, fmt="%.12f", header="fixed_T_moving")
    np.savetxt(tmp_path / "b.txt", POSE, fmt="%.12e", delimiter=", ")
    (tmp_path / "c.txt").write_text("\ufeff" + str(POSE.tolist()).replace("], ", "],\r\n"))
    for name in "abc":
        np.testing.assert_allclose(read_transform(tmp_path / f"{name}.txt"), POSE, atol=1e-9)


def test_text_that_is_no_pose(tmp_path: Path) -> None:
    for text, message in (
        ("", "received rows of no numbers"),
        ("1 0 0\n0 1 0\n0 0 1\n", "received rows of 3, 3, 3 numbers"),
        ("1,0 0,0 0,0 5,0\n" * 4, "received rows of 8, 8, 8, 8 numbers"),
        ("1 0 0 x\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "could not convert"),
        (
            "1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n",
            "with last row 0 0 0 1, received a transposed",
        ),
        ("2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", "expected orthonormal rotations"),
    ):
        (tmp_path / "pose.txt").write_text(text)
        assert message in refusal(tmp_path / "pose.txt")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_byte_order_marks(tmp_path: Path, encoding: str) -> None:
    write_transform(tmp_path / "pose.tfm", POSE)
    text = (tmp_path / "pose.tfm").read_text()
    (tmp_path / "marked.tfm").write_bytes(text.encode(encoding))
    (tmp_path / "marked.txt").write_bytes(text.encode(encoding))
    (tmp_path / "marked.json").write_bytes(json.dumps({"fixed_T_moving": POSE.tolist()}).encode(encoding))
    for suffix in ("tfm", "txt", "json"):
        np.testing.assert_allclose(read_transform(tmp_path / f"marked.{suffix}"), POSE, atol=1e-9)


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as refused:
        read_transform(path)
    text = str(refused.value)
    assert "\n" not in text
    assert path.name in text
    return text


def test_a_file_that_is_not_there_or_of_another_kind(tmp_path: Path) -> None:
    assert "expected a file, received nothing there" in refusal(tmp_path / "none.h5")
    (tmp_path / "pose.xyz").write_text("1 2 3")
    assert "expected a transform as .json" in refusal(tmp_path / "pose.xyz")


@pytest.mark.parametrize("suffix", [".tfm", ".h5"])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.3, 0.6, 0.93, 0.98])
def test_a_file_cut_short(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], suffix: str, share: float
) -> None:
    write_transform(tmp_path / f"pose{suffix}", POSE)
    whole = (tmp_path / f"pose{suffix}").read_bytes()
    (tmp_path / f"cut{suffix}").write_bytes(whole[: int(share * len(whole))])
    assert "expected" in refusal(tmp_path / f"cut{suffix}")
    # The libraries behind it print pages of their own otherwise.
    assert capfd.readouterr() == ("", "")


def test_a_file_of_another_kind_under_the_name(tmp_path: Path) -> None:
    (tmp_path / "text.h5").write_text(
        "not a transform at all, but long enough to hold the start of a header" * 3
    )
    assert "expected an HDF5 file" in refusal(tmp_path / "text.h5")
    (tmp_path / "text.tfm").write_text("hello")
    assert "expected a complete ITK transform" in refusal(tmp_path / "text.tfm")


@pytest.mark.parametrize(
    "text", ["{", "[]", "{}", '{"fixed_T_moving": [[1, 0], [0, 1]]}', '{"fixed_T_moving": "x"}']
)
def test_json_without_a_pose(tmp_path: Path, text: str) -> None:
    (tmp_path / "pose.json").write_text(text)
    assert "expected fixed_T_moving as 4 rows of 4 numbers" in refusal(tmp_path / "pose.json")


def test_transforms_that_are_not_rigid(tmp_path: Path) -> None:
    SimpleITK.WriteTransform(SimpleITK.ScaleTransform(3, [1.0, 1.0, 2.0]), str(tmp_path / "scale.tfm"))
    assert "expected orthonormal rotations" in refusal(tmp_path / "scale.tfm")
    mirror = SimpleITK.AffineTransform(3)
    mirror.SetMatrix([1.0, 0, 0, 0, 1, 0, 0, 0, -1])
    SimpleITK.WriteTransform(mirror, str(tmp_path / "mirror.h5"))
    assert "expected a right-handed rotation" in refusal(tmp_path / "mirror.h5")
    field = SimpleITK.DisplacementFieldTransform(SimpleITK.Image([4, 4, 4], SimpleITK.sitkVectorFloat64))
    SimpleITK.WriteTransform(field, str(tmp_path / "field.h5"))
    assert "expected a linear transform in three dimensions" in refusal(tmp_path / "field.h5")
    SimpleITK.WriteTransform(SimpleITK.Euler2DTransform(), str(tmp_path / "flat.tfm"))
    assert "received Euler2DTransform in 2" in refusal(tmp_path / "flat.tfm")
    (tmp_path / "nan.json").write_text(
        '{"fixed_T_moving": ' + str([[float("nan")] * 4] * 4).replace("nan", "NaN") + "}"
    )
    assert "expected finite entries" in refusal(tmp_path / "nan.json")


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected one of \.tfm, \.h5 to write, received \.json"):
        write_transform(tmp_path / "pose.json", POSE)
    with pytest.raises(InputError, match="fixed_T_moving: expected a right-handed rotation"):
        write_transform(tmp_path / "pose.h5", np.diag([1.0, 1, -1, 1]))
    assert not list(tmp_path.iterdir())
