"""Displacements through files: where ITK takes a point decides axes, signs and direction."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import SimpleITK

from registration.errors import InputError
from registration.io import displacement_fields
from registration.io.displacement_fields import (
    DisplacementGrid,
    read_displacement_grid,
    sample_grid,
    write_displacement_grid,
    write_displacement_transform,
)

LOW = np.array([-31.0, 12.0, -140.0])
HIGH = np.array([9.0, 42.0, -80.0])
# Another number of nodes along every axis: 41, 16 and 21.
SPACING = np.array([1.0, 2.0, 3.0])
RAS = np.array([-1.0, -1.0, 1.0])
# Linear interpolation is off by at most an eighth of the second derivatives times the squared spacing: of a bump of
# 5 mm and 20 mm standard deviation, at most 5 / 20^2 * (1 + 4 + 9) / 8 = 0.022 mm.
TOLERANCE_MM = 0.022


def bump(points_mm: np.ndarray) -> np.ndarray:
    """A smooth displacement of several millimetres, another along every axis."""
    middle_mm = np.array([-17.0, 31.0, -119.0])
    height = np.exp(-0.5 * ((points_mm - middle_mm) ** 2).sum(axis=1) / 20.0**2)
    return height[:, None] * np.array([2.0, -3.0, 5.0])


@pytest.fixture(scope="module")
def grid() -> DisplacementGrid:
    return sample_grid(bump, LOW, HIGH, SPACING)


def inside(count: int = 200) -> np.ndarray:
    return np.random.default_rng(5).uniform(LOW, HIGH, (count, 3))


def from_image(path: Path) -> SimpleITK.Transform:
    image = SimpleITK.Cast(SimpleITK.ReadImage(str(path)), SimpleITK.sitkVectorFloat64)
    return SimpleITK.DisplacementFieldTransform(image)


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(
    ("name", "write", "read"),
    [
        ("field.nrrd", write_displacement_grid, from_image),
        ("field.mha", write_displacement_grid, from_image),
        ("field.h5", write_displacement_transform, lambda path: SimpleITK.ReadTransform(str(path))),
    ],
)
@pytest.mark.parametrize(("space", "signs"), [("lps", np.ones(3)), ("ras", RAS)])
def test_itk_moves_a_point_by_its_displacement(
    tmp_path: Path,
    grid: DisplacementGrid,
    capfd: pytest.CaptureFixture[str],
    name: str,
    write: Callable[[Path, DisplacementGrid, str], None],
    read: Callable[[Path], SimpleITK.Transform],
    space: str,
    signs: np.ndarray,
) -> None:
    """In LPS, whatever axes the points are in; forward, not inverted."""
    write(tmp_path / "new folder" / name, grid, space)
    transform = read(tmp_path / "new folder" / name)
    points_mm = inside()
    moved_mm = np.array([transform.TransformPoint(point) for point in (signs * points_mm).tolist()])
    expected_mm = signs * (points_mm + bump(points_mm))
    np.testing.assert_allclose(moved_mm, expected_mm, rtol=0, atol=TOLERANCE_MM)
    # What the tolerance must tell apart: no component of the displacement is as small, nor its inverse as close.
    assert (np.abs(bump(points_mm)).max(axis=0) > 30 * TOLERANCE_MM).all()
    assert np.abs(signs * (points_mm - bump(points_mm)) - expected_mm).max() > 30 * TOLERANCE_MM
    assert files(tmp_path / "new folder") == [name]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("space", ["lps", "ras"])
def test_a_transform_file_says_what_it_is(tmp_path: Path, grid: DisplacementGrid, space: str) -> None:
    write_displacement_transform(tmp_path / "field.h5", grid, space)
    transform = SimpleITK.ReadTransform(str(tmp_path / "field.h5"))
    assert transform.GetName() == "DisplacementFieldTransform"
    assert b"DisplacementFieldTransform_double_3_3" in (tmp_path / "field.h5").read_bytes()
    field = SimpleITK.DisplacementFieldTransform(transform).GetDisplacementField()
    assert field.GetSize() == (41, 16, 21)
    assert field.GetDirection() == (1, 0, 0, 0, 1, 0, 0, 0, 1)


@pytest.mark.parametrize("suffix", [".nrrd", ".mha"])
@pytest.mark.parametrize("space", ["lps", "ras"])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_grid_comes_back_as_it_was(
    tmp_path: Path, grid: DisplacementGrid, suffix: str, space: str, kind: type
) -> None:
    written = DisplacementGrid(grid.origin_mm, grid.spacing_mm, grid.displacement_mm.astype(kind))
    write_displacement_grid(tmp_path / f"field{suffix}", written, space)
    read = read_displacement_grid(tmp_path / f"field{suffix}", space)
    np.testing.assert_allclose(read.origin_mm, LOW, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(read.spacing_mm, SPACING)
    np.testing.assert_array_equal(read.displacement_mm, written.displacement_mm)
    assert read.displacement_mm.dtype == kind


def test_a_grid_written_in_one_space_is_read_in_the_other(tmp_path: Path, grid: DisplacementGrid) -> None:
    """The node at p with the displacement d in RAS is the one at -x -y z with -dx -dy dz in LPS."""
    write_displacement_grid(tmp_path / "field.nrrd", grid, "ras")
    lps = read_displacement_grid(tmp_path / "field.nrrd", "lps")
    np.testing.assert_allclose(lps.origin_mm, [-9.0, -42.0, -140.0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(lps.displacement_mm, grid.displacement_mm[::-1, ::-1] * RAS)


@pytest.mark.parametrize(
    "direction",
    [(-1, 0, 0, 0, -1, 0, 0, 0, 1), (0, 0, -1, 1, 0, 0, 0, -1, 0), (0, 1, 0, 0, 0, -1, -1, 0, 0)],
)
def test_an_image_whose_axes_are_reversed_or_in_another_order(
    tmp_path: Path, direction: tuple[int, ...]
) -> None:
    """Not written here, but by others: what its nodes are to ITK is what the grid must say."""
    values = np.random.default_rng(2).normal(size=(4, 5, 6, 3))
    image = SimpleITK.GetImageFromArray(values, isVector=True)
    image.SetOrigin((10.0, 20.0, 30.0))
    image.SetSpacing((1.0, 2.0, 3.0))
    image.SetDirection(tuple(map(float, direction)))
    SimpleITK.WriteImage(image, str(tmp_path / "other.nrrd"))
    grid = read_displacement_grid(tmp_path / "other.nrrd", "lps")
    assert grid.displacement_mm.size == values.size
    for node in np.ndindex(grid.displacement_mm.shape[:3]):
        place_mm = grid.origin_mm + np.array(node) * grid.spacing_mm
        index = image.TransformPhysicalPointToIndex(place_mm.tolist())
        np.testing.assert_array_equal(grid.displacement_mm[node], image[index])


def test_nodes_lie_where_they_are_sampled(grid: DisplacementGrid) -> None:
    assert grid.displacement_mm.shape == (41, 16, 21, 3)
    np.testing.assert_allclose(grid.far_corner_mm, HIGH)
    corner_mm = bump((LOW + np.array([7.0, 10.0, 27.0]))[None])[0]
    np.testing.assert_allclose(grid.displacement_mm[7, 5, 9], corner_mm)


def test_the_box_is_covered_with_the_spacing_as_asked() -> None:
    grid = sample_grid(bump, np.zeros(3), np.array([10.0, 9.9, 0.5]), 2.5)
    assert grid.displacement_mm.shape == (5, 5, 2, 3)
    np.testing.assert_array_equal(grid.spacing_mm, [2.5, 2.5, 2.5])
    # Rounding alone adds no node: 0.3 / 0.1 is more than 3 by half a unit in the last place or less.
    assert sample_grid(bump, np.zeros(3), np.full(3, 0.1 * 3), 0.1).displacement_mm.shape == (4, 4, 4, 3)


def test_blocks_change_nothing(grid: DisplacementGrid, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = []

    def counted(points_mm: np.ndarray) -> np.ndarray:
        sizes.append(len(points_mm))
        return bump(points_mm)

    monkeypatch.setattr(displacement_fields, "BLOCK_NODES", 1000)
    blocked = sample_grid(counted, LOW, HIGH, SPACING)
    np.testing.assert_array_equal(blocked.displacement_mm, grid.displacement_mm)
    assert (max(sizes), len(sizes), sum(sizes)) == (1000, 14, 41 * 16 * 21)


def test_too_many_nodes_are_refused_with_a_spacing_that_does() -> None:
    with pytest.raises(InputError, match="expected one that needs at most 1000 nodes") as refused:
        sample_grid(bump, LOW, HIGH, SPACING, max_nodes=1000)
    assert "received 1 x 2 x 3, which needs 41 x 16 x 21" in str(refused.value)
    named = re.search(r"as (\S+) x (\S+) x (\S+) does", str(refused.value))
    assert named is not None
    spacing_mm = np.array(named.groups(), dtype=np.float64)
    np.testing.assert_allclose(spacing_mm / SPACING, spacing_mm[0], rtol=1e-3)
    nodes = sample_grid(bump, LOW, HIGH, spacing_mm, max_nodes=1000).displacement_mm.size // 3
    assert 700 < nodes <= 1000
    with pytest.raises(InputError, match="at most 2000000 nodes"):
        sample_grid(bump, LOW, HIGH, 0.01)


def test_boxes_and_spacings_that_make_no_grid() -> None:
    for low, high, spacing, message in (
        (HIGH, LOW, SPACING, "high_mm: expected coordinates above those of low_mm"),
        (LOW, np.where([True, False, False], LOW, HIGH), SPACING, "high_mm: expected coordinates above"),
        (LOW * np.nan, HIGH, SPACING, "low_mm: expected finite coordinates"),
        (LOW, HIGH + np.inf, SPACING, "high_mm: expected finite coordinates"),
        (LOW, HIGH, np.array([1.0, 0.0, 1.0]), "spacing_mm: expected finite numbers above 0"),
        (LOW, HIGH, -1.0, "spacing_mm: expected finite numbers above 0"),
        (LOW, HIGH, np.nan, "spacing_mm: expected finite numbers above 0"),
    ):
        with pytest.raises(InputError, match=message):
            sample_grid(bump, low, high, spacing)
    with pytest.raises(InputError, match="max_nodes: expected a whole number of at least 8, received 7"):
        sample_grid(bump, LOW, HIGH, SPACING, max_nodes=7)


def test_displacements_that_are_none() -> None:
    def torn(points_mm: np.ndarray) -> np.ndarray:
        second = (points_mm == LOW + np.array([0.0, 0.0, 3.0])).all(axis=1)
        return np.where(second[:, None], np.nan, points_mm)

    with pytest.raises(InputError, match=r"received NaN or infinity at 1 of 13776 nodes, .* \(0, 0, 1\)"):
        sample_grid(torn, LOW, HIGH, SPACING)
    with pytest.raises(InputError, match=r"displacement: expected an array of shape \(13776, 3\), received"):
        sample_grid(lambda points_mm: bump(points_mm)[0], LOW, HIGH, SPACING)
    with pytest.raises(InputError, match="received NaN or infinity at 27 of 27 nodes"):
        DisplacementGrid(LOW, SPACING, np.full((3, 3, 3, 3), np.inf))
    with pytest.raises(InputError, match="expected 2 nodes or more along every axis, received 3 x 1 x 3"):
        DisplacementGrid(LOW, SPACING, np.zeros((3, 1, 3, 3)))
    with pytest.raises(InputError, match="origin_mm: expected finite coordinates"):
        DisplacementGrid(LOW * np.inf, SPACING, np.zeros((3, 3, 3, 3)))


@pytest.mark.parametrize(
    ("write", "names"),
    [
        (write_displacement_grid, ("field.nii.gz", "field.h5", "field.MHA", "field")),
        (write_displacement_transform, ("field.tfm", "field.nrrd", "field.H5", "field")),
    ],
)
def test_what_cannot_be_written_is_refused(
    tmp_path: Path,
    grid: DisplacementGrid,
    write: Callable[[Path, DisplacementGrid, str], None],
    names: tuple[str, ...],
) -> None:
    for name in names:
        with pytest.raises(InputError, match=r"expected one of \..* to write, received"):
            write(tmp_path / name, grid, "lps")
    suffix = ".h5" if write is write_displacement_transform else ".mha"
    with pytest.raises(InputError, match="space: expected lps or ras, received 'LPS'"):
        write(tmp_path / f"field{suffix}", grid, "LPS")
    assert files(tmp_path) == []


@pytest.mark.parametrize(
    ("write", "writer", "name"),
    [
        (write_displacement_grid, "WriteImage", "field.nrrd"),
        (write_displacement_transform, "WriteTransform", "field.h5"),
    ],
)
def test_nothing_is_left_of_a_write_that_fails(
    tmp_path: Path,
    grid: DisplacementGrid,
    monkeypatch: pytest.MonkeyPatch,
    write: Callable[[Path, DisplacementGrid, str], None],
    writer: str,
    name: str,
) -> None:
    def full(_: object, path: str) -> None:
        Path(path).write_bytes(b"half")
        raise RuntimeError("disk full")

    monkeypatch.setattr(SimpleITK, writer, full)
    with pytest.raises(RuntimeError, match="disk full"):
        write(tmp_path / name, grid, "lps")
    assert files(tmp_path) == []
    (tmp_path / name).write_bytes(b"earlier")
    with pytest.raises(RuntimeError, match="disk full"):
        write(tmp_path / name, grid, "lps")
    assert (files(tmp_path), (tmp_path / name).read_bytes()) == ([name], b"earlier")


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as refused:
        read_displacement_grid(path, "lps")
    text = str(refused.value)
    assert "\n" not in text
    assert path.name in text
    return text


def test_files_that_are_not_there_or_cut_short(tmp_path: Path, grid: DisplacementGrid) -> None:
    assert "expected a file, received nothing there" in refusal(tmp_path / "none.mha")
    assert "expected one of .nrrd, .mha to read, received .gz" in refusal(tmp_path / "field.nii.gz")
    for name in ("field.nrrd", "field.mha"):
        write_displacement_grid(tmp_path / name, grid, "lps")
        (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:-8])
        assert "expected" in refusal(tmp_path / name)


@pytest.mark.parametrize("suffix", [".nrrd", ".mha"])
@pytest.mark.parametrize(
    ("values", "received"),
    [
        (np.zeros((3, 4, 5)), "3 axes, 1 a voxel"),
        (np.zeros((3, 4, 5, 2)), "3 axes, 2 a voxel"),
        (np.zeros((3, 4, 5, 3), dtype=np.uint8), "3 axes, 3 a voxel, vector of 8-bit unsigned integer"),
        (np.zeros((4, 5, 3)), "2 axes, 3 a voxel"),
    ],
)
def test_images_without_vectors(tmp_path: Path, suffix: str, values: np.ndarray, received: str) -> None:
    image = SimpleITK.GetImageFromArray(values, isVector=values.shape[-1] <= 3)
    SimpleITK.WriteImage(image, str(tmp_path / f"image{suffix}"))
    assert received in refusal(tmp_path / f"image{suffix}")


def written(path: Path, values: np.ndarray, direction: np.ndarray | None = None) -> Path:
    image = SimpleITK.GetImageFromArray(values, isVector=True)
    image.SetDirection((np.eye(3) if direction is None else direction).ravel().tolist())
    SimpleITK.WriteImage(image, str(path))
    return path


@pytest.mark.parametrize("name", ["turned.nrrd", "turned.mha"])
def test_oblique_axes(tmp_path: Path, name: str) -> None:
    for degrees in (0.01, 20.0, 45.0):
        sine, cosine = np.sin(np.deg2rad(degrees)), np.cos(np.deg2rad(degrees))
        direction = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
        text = refusal(written(tmp_path / name, np.zeros((3, 4, 5, 3)), direction))
        assert "expected axes parallel to those of LPS within 1e-06" in text


def test_vectors_that_cannot_be_trusted(tmp_path: Path) -> None:
    path = written(tmp_path / "field.nrrd", np.zeros((3, 4, 5, 3)))
    plain = path.read_bytes()
    path.write_bytes(plain.replace(b"left-posterior-superior", b"right-anterior-superior"))
    assert "expected space left-posterior-superior, received right-anterior-superior" in refusal(path)
    path.write_bytes(plain.replace(b"space: left-posterior-superior", b"space dimension: 3"))
    assert "expected space left-posterior-superior, received none" in refusal(path)
    path.write_bytes(plain.replace(b"endian:", b'space units: "cm" "cm" "cm"\nendian:'))
    assert "expected lengths in mm, because the vectors' unit is not stated, received cm" in refusal(path)
    assert "received NaN or infinity" in refusal(written(path, np.full((3, 4, 5, 3), np.nan)))
    assert "expected 2 nodes or more along every axis" in refusal(written(path, np.zeros((1, 4, 5, 3))))
    with pytest.raises(InputError, match="space: expected lps or ras, received 'RAS'"):
        read_displacement_grid(written(path, np.zeros((3, 4, 5, 3))), "RAS")
