"""Anyone's displacement field: at a point it is what ITK has there, in any orientation, and never a guess."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import SimpleITK
from scipy.spatial.transform import Rotation

from registration.errors import InputError
from registration.io.displacement_fields import (
    sample_grid,
    write_displacement_grid,
    write_displacement_transform,
)
from registration.io.sampled_displacement import SampledDisplacement, read_sampled_displacement

SIZE = (9, 12, 15)
OBLIQUE = Rotation.from_euler("xyz", (20.0, -35.0, 50.0), degrees=True).as_matrix()
RAS = np.diag([-1.0, -1.0, 1.0])
# A linear displacement, which trilinear interpolation hits exactly.
SLOPE = np.array([[0.05, -0.02, 0.01], [0.03, 0.04, -0.06], [-0.01, 0.02, 0.03]])
SHIFT_MM = np.array([2.0, -3.0, 0.5])


def moved_by(points_mm: np.ndarray) -> np.ndarray:
    return points_mm @ SLOPE.T + SHIFT_MM


def image_of(direction: np.ndarray, displacement=moved_by, spacing=(2.0, 1.5, 3.0)) -> SimpleITK.Image:
    """A field at the nodes of a grid in LPS, by SimpleITK alone."""
    image = SimpleITK.Image(*SIZE, SimpleITK.sitkVectorFloat64)
    image.SetOrigin((-11.0, 25.0, 40.0))
    image.SetSpacing(spacing)
    image.SetDirection(direction.ravel().tolist())
    for node in np.ndindex(*SIZE):
        place_mm = np.array(image.TransformIndexToPhysicalPoint(node))
        image[node] = displacement(place_mm[None])[0].tolist()
    return image


def inside(image: SimpleITK.Image, count: int = 40) -> np.ndarray:
    places = np.random.default_rng(3).uniform(0, np.array(SIZE) - 1.0, (count, 3))
    return np.array([image.TransformContinuousIndexToPhysicalPoint(place.tolist()) for place in places])


@pytest.mark.parametrize("direction", [np.eye(3), RAS, OBLIQUE, OBLIQUE[:, [1, 0, 2]]])
@pytest.mark.parametrize("name", ["field.nrrd", "field.mha", "field.h5", "composite.h5"])
def test_a_point_is_displaced_as_itk_displaces_it(name: str, direction: np.ndarray, tmp_path: Path) -> None:
    image = image_of(direction)
    transform = SimpleITK.DisplacementFieldTransform(SimpleITK.Image(image))
    if name == "composite.h5":
        SimpleITK.WriteTransform(SimpleITK.CompositeTransform([transform]), str(tmp_path / name))
    elif name == "field.h5":
        SimpleITK.WriteTransform(transform, str(tmp_path / name))
    else:
        SimpleITK.WriteImage(image, str(tmp_path / name))
    points_mm = inside(image)
    found = read_sampled_displacement(tmp_path / name)(points_mm)
    itk = np.array([transform.TransformPoint(point.tolist()) for point in points_mm]) - points_mm
    np.testing.assert_allclose(found, itk, atol=1e-9)
    np.testing.assert_allclose(found, moved_by(points_mm), atol=1e-9)


@pytest.mark.parametrize(
    ("write", "name"), [(write_displacement_grid, "a.mha"), (write_displacement_transform, "a.h5")]
)
def test_a_field_sampled_in_ras_is_read_in_lps(write, name: str, tmp_path: Path) -> None:
    low_mm, high_mm = np.array([-10.0, 5.0, 30.0]), np.array([14.0, 25.0, 60.0])
    write(tmp_path / name, sample_grid(moved_by, low_mm, high_mm, 2.0), "ras")
    points_ras_mm = np.random.default_rng(0).uniform(low_mm, high_mm, (30, 3))
    found = read_sampled_displacement(tmp_path / name)(points_ras_mm @ RAS)
    np.testing.assert_allclose(found, moved_by(points_ras_mm) @ RAS, atol=1e-9)


def test_the_smallest_volume_factor_of_a_linear_field_is_its_determinant(tmp_path: Path) -> None:
    for direction in (OBLIQUE, OBLIQUE[:, [1, 0, 2]]):
        SimpleITK.WriteImage(image_of(direction), str(tmp_path / "a.mha"))
        found = read_sampled_displacement(tmp_path / "a.mha").jacobian_min()
        assert found == pytest.approx(np.linalg.det(np.eye(3) + SLOPE))


def test_a_fold_of_one_node_against_its_neighbours_is_seen() -> None:
    """Central differences see nothing of an alternating displacement."""
    values = np.zeros((8, 8, 8, 3))
    values[..., 0] = np.where(np.arange(8) % 2, 0.6, -0.6)[:, None, None]
    assert SampledDisplacement(np.zeros(3), np.eye(3), values).jacobian_min() == pytest.approx(-0.2)
    assert SampledDisplacement(np.zeros(3), 10 * np.eye(3), values).jacobian_min() == pytest.approx(0.88)


def test_slabs_together_have_every_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(1).normal(0.0, 0.2, (9, 4, 5, 3))
    field = SampledDisplacement(np.zeros(3), 2 * np.eye(3), values)
    whole = field.jacobian_min()
    monkeypatch.setattr("registration.io.sampled_displacement.CELLS_AT_ONCE", 1)
    assert field.jacobian_min() == whole


def test_outside_the_grid_nothing_is_known(tmp_path: Path) -> None:
    image = image_of(OBLIQUE)
    SimpleITK.WriteImage(image, str(tmp_path / "a.nrrd"))
    field = read_sampled_displacement(tmp_path / "a.nrrd")
    corner_mm = np.array(image.TransformIndexToPhysicalPoint(tuple(length - 1 for length in SIZE)))
    np.testing.assert_allclose(field(corner_mm[None]), moved_by(corner_mm[None]), atol=1e-9)
    beyond_mm = corner_mm + 2.0 * OBLIQUE[:, 0]
    with pytest.raises(InputError, match=r"leaves out 1 of 2, up to 2 mm away"):
        field(np.stack([corner_mm, beyond_mm]))


def spoiled(image: SimpleITK.Image) -> SimpleITK.Image:
    image[3, 3, 3] = (float("nan"), 0.0, 0.0)
    return image


@pytest.mark.parametrize(
    ("image", "sentence"),
    [
        (spoiled(image_of(np.eye(3))), "received NaN or infinity at 1 of 1620 nodes"),
        (image_of(np.eye(3), lambda at: 1e-3 * moved_by(at)[:, :3] * 0.5), "which looks like metres"),
        (image_of(np.eye(3), spacing=(0.002, 0.0015, 0.003)), "a grid in millimetres, .* like metres"),
        (image_of(np.eye(3), lambda at: 1e3 * moved_by(at)), "displacements in millimetres, received one of"),
        (SimpleITK.Image(*SIZE, SimpleITK.sitkFloat64), "vectors of 3 floating-point numbers"),
        (SimpleITK.Image([9, 9], SimpleITK.sitkVectorFloat64, 3), "an image of 3 axes"),
        (SimpleITK.Image([9, 9, 1], SimpleITK.sitkVectorFloat64, 3), "2 nodes or more along every axis"),
    ],
)
def test_what_is_no_field_in_millimetres_is_refused_by_name(
    image: SimpleITK.Image, sentence: str, tmp_path: Path
) -> None:
    SimpleITK.WriteImage(image, str(tmp_path / "a.mha"))
    with pytest.raises(InputError, match=rf"a\.mha: .*{sentence}"):
        read_sampled_displacement(tmp_path / "a.mha")


def test_zeros_are_a_displacement(tmp_path: Path) -> None:
    SimpleITK.WriteImage(image_of(np.eye(3), np.zeros_like), str(tmp_path / "a.mha"))
    field = read_sampled_displacement(tmp_path / "a.mha")
    assert not field(np.array([[-10.0, 26.0, 41.0]])).any() and field.jacobian_min() == pytest.approx(1.0)


def test_files_of_other_kinds_are_refused(tmp_path: Path) -> None:
    SimpleITK.WriteTransform(SimpleITK.Euler3DTransform(), str(tmp_path / "rigid.h5"))
    (tmp_path / "broken.h5").write_bytes(b"no transform")
    (tmp_path / "a.npz").write_bytes(b"")
    for name, sentence in (
        ("rigid.h5", "a displacement field transform in three dimensions, received Euler3DTransform"),
        ("broken.h5", "expected (an HDF5 file|a complete ITK transform)"),
        ("a.npz", r"\.npz"),
        ("none.mha", "none.mha"),
    ):
        with pytest.raises(InputError, match=sentence):
            read_sampled_displacement(tmp_path / name)
