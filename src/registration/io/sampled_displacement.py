"""Anyone's displacement field from a file, at any points: an ITK grid in any orientation, or a transform of one."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64
from scipy.ndimage import map_coordinates

from registration.errors import InputError
from registration.geometry.shapes import METRES_BELOW_MM
from registration.input_files import guarded
from registration.io.displacement_fields import require_vectors
from registration.io.transforms import require_whole_hdf5
from registration.io.trial_process import require_harmless_transform
from registration.io.truncation import require_file
from registration.io.volumes import read_volume

IMAGES, TRANSFORMS = (".nrrd", ".mha"), (".h5",)
SUFFIXES = (*IMAGES, *TRANSFORMS)
# A field that moves nothing by more than this, and yet something, is taken for one in metres: of 20 mm at most.
METRES_BELOW = 0.02
# Points beyond the outermost nodes by less than this share of a spacing lie on them but for rounding.
ROUNDING = 1e-3
# Volume factors are computed in slabs of so many cells.
CELLS_AT_ONCE = 500_000


@dataclass(frozen=True)
class SampledDisplacement:
    """Displacements at the nodes of a grid, in any orientation, trilinear between them.

    Parameters
    ----------
    origin_mm : ndarray, shape (3,)
        Place of the node (0, 0, 0) in mm.
    mm_A_node : ndarray, shape (3, 3)
        Columns: the step in mm from a node to the next along each axis of the grid.
    displacement_mm : ndarray, shape (x, y, z, 3)
        Displacement of each node in mm, in the frame of the places; at least two nodes along every axis.

    Raises
    ------
    InputError
        If there are fewer nodes, a number is not finite, or the field looks like one in metres.
    """

    origin_mm: Float64[np.ndarray, "3"]
    mm_A_node: Float64[np.ndarray, "3 3"]
    displacement_mm: Float32[np.ndarray, "x y z 3"] | Float64[np.ndarray, "x y z 3"]

    def __post_init__(self) -> None:
        nodes = self.displacement_mm.shape[:3]
        if min(nodes) < 2:
            raise InputError(f"expected 2 nodes or more along every axis, received {nodes}")
        wrong = ~np.isfinite(self.displacement_mm).all(axis=-1)
        if wrong.any():
            raise InputError(
                f"expected finite displacements, received NaN or infinity at {int(wrong.sum())} of {wrong.size} nodes"
            )
        across_mm = float(np.linalg.norm(self.mm_A_node @ (np.array(nodes) - 1.0)))
        if across_mm < METRES_BELOW_MM:
            raise InputError(
                f"expected a grid in millimetres, received one {across_mm:.3g} across, which looks like metres"
            )
        largest_mm = float(np.sqrt((self.displacement_mm.astype(np.float64) ** 2).sum(axis=-1).max()))
        if 0 < largest_mm < METRES_BELOW:
            raise InputError(
                f"expected displacements in millimetres, received none above {largest_mm:.3g}, which looks like metres"
            )
        if largest_mm > across_mm:
            raise InputError(
                f"expected displacements in millimetres, received one of {largest_mm:.3g} in a grid {across_mm:.3g} mm "
                "across"
            )

    def __call__(self, points_mm: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Interpolate the displacement at points.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3)
            Points in mm.

        Returns
        -------
        ndarray, shape (n, 3)
            Displacements in mm.

        Raises
        ------
        InputError
            If a point lies outside the grid, where nothing is known.
        """
        place = np.linalg.solve(self.mm_A_node, (points_mm - self.origin_mm).T)
        last = np.array(self.displacement_mm.shape[:3])[:, None] - 1.0
        beyond = np.maximum(np.maximum(-place, place - last), 0.0)
        outside = (beyond > ROUNDING).any(axis=0)
        if outside.any():
            away_mm = float(np.linalg.norm(self.mm_A_node @ beyond, axis=0).max())
            raise InputError(
                f"expected a grid that holds all places that are asked for, received one that leaves out "
                f"{int(outside.sum())} of {len(points_mm)}, up to {away_mm:.3g} mm away from it"
            )
        return np.stack(
            [
                map_coordinates(self.displacement_mm[..., axis], place, np.float64, order=1, mode="nearest")
                for axis in range(3)
            ],
            axis=1,
        )

    def jacobian_min(self) -> float:
        """Compute the smallest Jacobian determinant of the moved place: the factor on a small volume.

        It is that of the trilinear field at every corner of every cell. Central differences at the nodes would miss
        folds of one node against its neighbours.

        Returns
        -------
        float
            Smallest determinant; at 0 and below the field folds.

        References
        ----------
        Y. Liu et al., Int. J. Comput. Vis. 132, 2024.
        """
        nodes = self.displacement_mm.shape[:3]
        step = max(1, CELLS_AT_ONCE // max((nodes[1] - 1) * (nodes[2] - 1), 1))
        slabs = (
            self.displacement_mm[start : start + step + 1].astype(np.float64)
            for start in range(0, nodes[0] - 1, step)
        )
        return min(_smallest_of_cells(slab, self.mm_A_node) for slab in slabs)


@guarded("a displacement field")
def read_sampled_displacement(path: Path) -> SampledDisplacement:
    """Read an ITK displacement field, an image of vectors or a transform, in LPS and mm.

    Parameters
    ----------
    path : Path
        Image of vectors of three floating-point numbers (``.nrrd``, ``.mha``), its axes in any direction; or a
        displacement field transform (``.h5``), also as the only part of a composite one.

    Returns
    -------
    SampledDisplacement
        The field, in LPS and mm.

    Raises
    ------
    InputError
        If the file is missing, unreadable or of another kind, its vectors are not known to be in LPS and mm or not
        finite, or the field looks like one in metres; the message names the file.
    """
    import SimpleITK

    path = require_file(Path(path))
    if path.suffix not in SUFFIXES:
        raise InputError(
            f"{path}: expected a displacement field ({', '.join(SUFFIXES)}), received {path.suffix or 'no suffix'}"
        )
    if path.suffix in TRANSFORMS:
        image = _field_of_transform(path)
    else:
        image = read_volume(path)
        require_vectors(path, image)
    # SimpleITK hands arrays over with the last axis first, and the vector's components last.
    values = SimpleITK.GetArrayFromImage(image).transpose(2, 1, 0, 3)
    mm_A_node = np.array(image.GetDirection()).reshape(3, 3) * np.array(image.GetSpacing())
    try:
        return SampledDisplacement(np.array(image.GetOrigin()), mm_A_node, values)
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal


def _field_of_transform(path: Path) -> Any:
    import SimpleITK

    require_whole_hdf5(path)
    require_harmless_transform(path)
    try:
        transform = SimpleITK.ReadTransform(str(path))
    except RuntimeError as refusal:
        raise InputError(
            f"{path}: expected a complete ITK transform, received a file that cannot be read as one"
        ) from refusal
    if isinstance(transform, SimpleITK.CompositeTransform) and transform.GetNumberOfTransforms() == 1:
        transform = transform.GetNthTransform(0)
    if not isinstance(transform, SimpleITK.DisplacementFieldTransform) or transform.GetDimension() != 3:
        raise InputError(
            f"{path}: expected a displacement field transform in three dimensions, received {transform.GetName()} in "
            f"{transform.GetDimension()}"
        )
    return transform.GetDisplacementField()


def _smallest_of_cells(
    values: Float64[np.ndarray, "x y z 3"], mm_A_node: Float64[np.ndarray, "3 3"]
) -> float:
    """The smallest determinant over the corners of a slab's cells."""
    cells = tuple(length - 1 for length in values.shape[:3])
    differences = [np.diff(values, axis=axis) + mm_A_node[:, axis] for axis in range(3)]
    smallest = np.inf
    for corner in itertools.product((0, 1), repeat=3):
        edges = []
        for axis, difference in enumerate(differences):
            # Along its own axis a cell has one edge from each corner, and it is the same from both ends.
            starts = [0 if other == axis else at for other, at in enumerate(corner)]
            edges.append(
                difference[tuple(slice(at, at + length) for at, length in zip(starts, cells, strict=True))]
            )
        volumes = np.einsum("xyzk,xyzk->xyz", edges[0], np.cross(edges[1], edges[2]))
        smallest = min(smallest, float((volumes / np.linalg.det(mm_A_node)).min()))
    return smallest
