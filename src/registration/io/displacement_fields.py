"""Displacements sampled on a regular grid, to and from files that ITK and 3D Slicer read.

Every file here maps a point p to p + displacement(p), in LPS and mm, which ITK calls transforming a point. Nothing is
inverted on the way, unlike a ``fixed_T_moving`` in ``registration.io.transforms``, because the inverse of a
displacement is not known exactly. What a resampler wants, fixed points to moving ones, is therefore written from the
displacement at fixed points. 3D Slicer takes what it reads as the transform "from parent" (Slicer developer guide,
"Transforms"): a model put under it moves by the inverse. For a model that is to move by the displacement itself,
invert the transform in its Transforms module, or write the inverse displacement.

Between the nodes ITK interpolates linearly. More than half a spacing outside the grid its displacement is 0, so the
grid should reach beyond whatever is to be moved.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64

from registration.brief import brief_repr
from registration.checks import require_count
from registration.errors import InputError
from registration.io.atomic import atomic_write
from registration.io.nrrd_file import read_nrrd_file
from registration.io.patient_space import lps_from
from registration.io.volumes import UNITS_KEY, read_volume

WRITABLE_IMAGES = (".nrrd", ".mha")
WRITABLE_TRANSFORMS = (".h5",)
BLOCK_NODES = 20_000
# At the far end of a grid of 1 m, axes turned by this much are off by a micrometre.
AXES_TOLERANCE = 1e-6
# Share of a spacing by which a box may be longer than a whole number of them, from rounding, without another node.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class DisplacementGrid:
    """Displacements at the nodes of a regular grid whose axes are those of the points' coordinates.

    Node (i, j, k) lies at ``origin_mm + (i, j, k) * spacing_mm``. Origin and displacements are in one frame, that
    of the points at which the displacement was sampled.

    Parameters
    ----------
    origin_mm : ndarray, shape (3,)
        Node with the lowest coordinates, in mm.
    spacing_mm : ndarray, shape (3,)
        Distance of neighbouring nodes along x, y and z in mm, above 0.
    displacement_mm : ndarray, shape (x, y, z, 3)
        Displacement of each node in mm, single or double precision; at least two nodes along every axis.
    """

    origin_mm: Float64[np.ndarray, "3"]
    spacing_mm: Float64[np.ndarray, "3"]
    displacement_mm: Float32[np.ndarray, "x y z 3"] | Float64[np.ndarray, "x y z 3"]

    __repr__ = brief_repr

    def __post_init__(self) -> None:
        _require_finite("origin_mm", self.origin_mm)
        _require_spacing(self.spacing_mm)
        nodes = self.displacement_mm.shape[:3]
        if min(nodes) < 2:
            raise InputError(
                f"displacement_mm: expected 2 nodes or more along every axis, received {_by(nodes)}"
            )
        wrong = np.argwhere(~np.isfinite(self.displacement_mm).all(axis=-1))
        if len(wrong):
            raise InputError(
                f"displacement_mm: expected finite displacements, received NaN or infinity at {len(wrong)} of "
                f"{math.prod(nodes)} nodes, the first of them {tuple(wrong[0].tolist())}"
            )

    @property
    def far_corner_mm(self) -> Float64[np.ndarray, "3"]:
        """The node with the highest coordinates, in mm."""
        return self.origin_mm + (np.array(self.displacement_mm.shape[:3]) - 1) * self.spacing_mm


def sample_grid(
    displacement: Callable[[Float64[np.ndarray, "n 3"]], Float[np.ndarray, "n 3"]],
    low_mm: Float64[np.ndarray, "3"],
    high_mm: Float64[np.ndarray, "3"],
    spacing_mm: float | Float64[np.ndarray, "3"],
    max_nodes: int = 2_000_000,
) -> DisplacementGrid:
    """Sample a displacement at the nodes of a grid over a box, in blocks of ``BLOCK_NODES`` points.

    The first node lies at ``low_mm``. The spacing is kept as it is: where the box is no whole number of them long,
    the last nodes lie beyond ``high_mm``, by less than a spacing.

    Parameters
    ----------
    displacement : callable
        Takes points, shape (n, 3), in mm to their displacements, shape (n, 3), in mm, in the same frame.
    low_mm, high_mm : ndarray, shape (3,)
        Opposite corners of the box in mm, in the frame of the points, the lowest coordinates first.
    spacing_mm : float or ndarray, shape (3,)
        Distance of neighbouring nodes in mm, the same for every axis or one for each.
    max_nodes : int, optional
        Largest number of nodes, at least 8.

    Returns
    -------
    DisplacementGrid
        Nodes and their displacements in the frame of the points, in double precision.

    Raises
    ------
    InputError
        If the box is empty, the spacing is not above 0 or needs more nodes than ``max_nodes`` (the message names one
        that does not), or ``displacement`` returns another shape, NaN or infinity.
    """
    require_count("max_nodes", max_nodes, 8)
    _require_finite("low_mm", low_mm)
    _require_finite("high_mm", high_mm)
    if not (low_mm < high_mm).all():
        raise InputError(
            f"high_mm: expected coordinates above those of low_mm, {low_mm.tolist()}, received {high_mm.tolist()}"
        )
    spacing = np.broadcast_to(np.asarray(spacing_mm, dtype=np.float64), 3).copy()
    _require_spacing(spacing)
    nodes = _nodes(high_mm - low_mm, spacing)
    if math.prod(nodes) > max_nodes:
        raise InputError(
            f"spacing_mm: expected one that needs at most {max_nodes} nodes, as "
            f"{_by(_spacing_for(high_mm - low_mm, spacing, max_nodes))} does, received {_by(spacing)}, which needs "
            f"{_by(nodes)}"
        )
    sampled = np.empty((math.prod(nodes), 3))
    for start in range(0, len(sampled), BLOCK_NODES):
        block = np.arange(start, min(start + BLOCK_NODES, len(sampled)))
        points_mm = low_mm + np.stack(np.unravel_index(block, nodes), axis=1) * spacing
        values = np.asarray(displacement(points_mm))
        if values.shape != (len(block), 3):
            raise InputError(
                f"displacement: expected an array of shape {(len(block), 3)}, received {values.shape}"
            )
        sampled[block] = values
    return DisplacementGrid(low_mm.copy(), spacing, sampled.reshape(*nodes, 3))


def write_displacement_grid(path: Path, grid: DisplacementGrid, space: str) -> None:
    """Write a grid as an ITK displacement field: an image of vectors, which maps p to p + displacement(p) in LPS.

    Parameters
    ----------
    path : Path
        File ending in ``.nrrd`` or ``.mha``; its folder is made if it is absent.
    grid : DisplacementGrid
        Displacements in mm, stored in their precision.
    space : {'lps', 'ras'}
        Axes of the grid's coordinates and displacements; both are converted to LPS.

    Raises
    ------
    InputError
        If the suffix or the axes are others.
    """
    import SimpleITK

    path = _require_suffix(path, WRITABLE_IMAGES, "write")
    image = _lps_image(grid, space)
    with atomic_write(path) as temporary:
        SimpleITK.WriteImage(image, str(temporary))


def write_displacement_transform(path: Path, grid: DisplacementGrid, space: str) -> None:
    """Write a grid as an ITK transform, which maps p to p + displacement(p) in LPS.

    3D Slicer loads it as a grid transform "from parent": a model put under it moves by the inverse. The module's
    description says what to do where it is to move by the displacement itself.

    Parameters
    ----------
    path : Path
        File ending in ``.h5``; its folder is made if it is absent.
    grid : DisplacementGrid
        Displacements in mm, stored in double precision.
    space : {'lps', 'ras'}
        Axes of the grid's coordinates and displacements; both are converted to LPS.

    Raises
    ------
    InputError
        If the suffix or the axes are others.
    """
    import SimpleITK

    path = _require_suffix(path, WRITABLE_TRANSFORMS, "write")
    image = SimpleITK.Cast(_lps_image(grid, space), SimpleITK.sitkVectorFloat64)
    transform = SimpleITK.DisplacementFieldTransform(image)
    with atomic_write(path) as temporary:
        SimpleITK.WriteTransform(transform, str(temporary))


def read_displacement_grid(path: Path, space: str) -> DisplacementGrid:
    """Read an ITK displacement field into a grid.

    Parameters
    ----------
    path : Path
        Image of vectors of three floating-point numbers in LPS and mm, ending in ``.nrrd`` or ``.mha``; its axes
        may be those of LPS in any order and either direction.
    space : {'lps', 'ras'}
        Axes that the grid's coordinates and displacements are wanted in.

    Returns
    -------
    DisplacementGrid
        Displacements in mm, in the precision of the file.

    Raises
    ------
    InputError
        If the file is missing, unreadable or of another kind, its vectors are not known to be in LPS and mm or not
        finite, its axes are oblique or have a single node, or ``space`` is another.
    """
    import SimpleITK

    path = _require_suffix(path, WRITABLE_IMAGES, "read")
    image = read_volume(path)
    require_vectors(path, image)
    axes, signs = _aligned_axes(path, image)
    order = np.argsort(axes)
    # SimpleITK hands arrays over with the last axis first, and the vector's components last.
    values = SimpleITK.GetArrayFromImage(image).transpose(2, 1, 0, 3)
    values = np.flip(values, tuple(np.flatnonzero(signs < 0))).transpose(*order, 3)
    spacing_mm = np.array(image.GetSpacing())[order]
    backward_mm = np.where(signs[order] < 0, (np.array(values.shape[:3]) - 1) * spacing_mm, 0.0)
    try:
        grid = DisplacementGrid(np.array(image.GetOrigin()) - backward_mm, spacing_mm, values)
    except InputError as refusal:
        raise InputError(f"{path}: {refusal}") from refusal
    return _between_lps_and(space, grid)


def _between_lps_and(space: str, grid: DisplacementGrid) -> DisplacementGrid:
    """The grid converted from a space to LPS, or, which is the same, from LPS to it.

    Where an axis is reversed the nodes are put in the opposite order, so that the spacing stays positive and no file
    depends on a reader that obeys the direction of its axes.
    """
    signs = lps_from(np.ones((1, 3)), space)[0]
    displacement_mm = np.flip(grid.displacement_mm, tuple(np.flatnonzero(signs < 0)))
    return DisplacementGrid(
        signs * np.where(signs < 0, grid.far_corner_mm, grid.origin_mm),
        grid.spacing_mm,
        displacement_mm * signs.astype(displacement_mm.dtype),
    )


def _lps_image(grid: DisplacementGrid, space: str) -> Any:
    import SimpleITK

    lps = _between_lps_and(space, grid)
    # SimpleITK takes arrays with the last axis first, and the vector's components last.
    values = np.ascontiguousarray(lps.displacement_mm.transpose(2, 1, 0, 3))
    image = SimpleITK.GetImageFromArray(values, isVector=True)
    image.SetOrigin(lps.origin_mm.tolist())
    image.SetSpacing(lps.spacing_mm.tolist())
    return image


def require_vectors(path: Path, image: Any) -> None:
    """Check that a file's image is a displacement field in LPS and mm.

    Parameters
    ----------
    path : Path
        File, for its header and for messages.
    image : SimpleITK.Image
        Image as ``read_volume`` gives it.

    Raises
    ------
    InputError
        If it is no image of three axes with vectors of three floating-point numbers, or these are not known to be in
        LPS and mm.
    """
    import SimpleITK

    kinds = (SimpleITK.sitkVectorFloat32, SimpleITK.sitkVectorFloat64)
    components = image.GetNumberOfComponentsPerPixel()
    if image.GetDimension() != 3 or components != 3 or image.GetPixelID() not in kinds:
        raise InputError(
            f"{path}: expected an image of 3 axes with vectors of 3 floating-point numbers, received "
            f"{image.GetDimension()} axes, {components} a voxel, {image.GetPixelIDTypeAsString()}"
        )
    units = image.GetMetaData(UNITS_KEY)
    if units not in ("", "mm"):
        raise InputError(
            f"{path}: expected lengths in mm, because the vectors' unit is not stated, received {units}"
        )
    if path.suffix == ".nrrd":
        # ITK converts the places of nodes from other axes, but leaves the vectors as they are.
        stated = read_nrrd_file(path).fields.get("space", "none")
        if stated.lower() not in ("left-posterior-superior", "lps"):
            raise InputError(f"{path}: expected space left-posterior-superior, received {stated}")


def _aligned_axes(path: Path, image: Any) -> tuple[np.ndarray, np.ndarray]:
    """For each axis of an image, the axis of LPS along which it runs, and 1 or, where it runs backwards, -1."""
    direction = np.array(image.GetDirection()).reshape(3, 3)
    axes = np.abs(direction).argmax(axis=0)
    signs = np.sign(direction[axes, np.arange(3)])
    aligned = np.zeros((3, 3))
    aligned[axes, np.arange(3)] = signs
    defect = float(np.abs(direction - aligned).max())
    if sorted(axes.tolist()) != [0, 1, 2] or not defect <= AXES_TOLERANCE:
        raise InputError(
            f"{path}: expected axes parallel to those of LPS within {AXES_TOLERANCE:g}, received the direction "
            f"{direction.round(6).tolist()}"
        )
    return axes, signs


def _nodes(extent_mm: np.ndarray, spacing_mm: np.ndarray) -> tuple[int, ...]:
    """The number of nodes along each axis that cover a box, at least two."""
    return tuple(max(math.ceil(steps - _ROUNDING), 1) + 1 for steps in (extent_mm / spacing_mm).tolist())


def _spacing_for(extent_mm: np.ndarray, spacing_mm: np.ndarray, max_nodes: int) -> np.ndarray:
    """A spacing of the same proportions that needs few enough nodes, also when rounded to four digits."""
    while math.prod(_nodes(extent_mm, spacing_mm)) > max_nodes:
        spacing_mm = 1.02 * spacing_mm
    return 1.001 * spacing_mm


def _by(numbers: Any) -> str:
    return " x ".join(f"{number:.4g}" if isinstance(number, float) else str(number) for number in numbers)


def _require_finite(name: str, corner_mm: np.ndarray) -> None:
    if not np.isfinite(corner_mm).all():
        raise InputError(f"{name}: expected finite coordinates, received {corner_mm.tolist()}")


def _require_spacing(spacing_mm: np.ndarray) -> None:
    if not (np.isfinite(spacing_mm).all() and (spacing_mm > 0).all()):
        raise InputError(f"spacing_mm: expected finite numbers above 0, received {spacing_mm.tolist()}")


def _require_suffix(path: Path, suffixes: tuple[str, ...], purpose: str) -> Path:
    """The path, whose suffix must be in small letters: under .MHA ITK writes no file of that name, under .H5 none."""
    path = Path(path)
    if path.suffix not in suffixes:
        raise InputError(
            f"{path}: expected one of {', '.join(suffixes)} to {purpose}, received {path.suffix or 'no suffix'}"
        )
    return path
