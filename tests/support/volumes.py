"""Label volumes of shapes known by formula, on grids of any spacing and direction, and files of them."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from registration.ct_model.label_map import LabelMap

OBLIQUE = Rotation.from_rotvec([0.5, -0.4, 0.9]).as_matrix()
Inside = Callable[[np.ndarray], np.ndarray]


def voxel_axes(
    spacing_mm: tuple[float, ...], direction: np.ndarray, origin_mm: tuple[float, ...]
) -> np.ndarray:
    """The map from voxels to mm."""
    matrix = np.eye(4)
    matrix[:3, :3] = direction * np.array(spacing_mm)
    matrix[:3, 3] = origin_mm
    return matrix


def voxelised(
    inside: Inside,
    low_mm: np.ndarray,
    high_mm: np.ndarray,
    spacing_mm: tuple[float, ...],
    direction: np.ndarray,
    label: int = 1,
) -> LabelMap:
    """The label of all voxels whose centres lie inside, on a grid that covers the box between two corners."""
    axes = direction * np.array(spacing_mm)
    corners = np.stack(np.meshgrid(*zip(low_mm, high_mm, strict=True)), axis=-1).reshape(-1, 3)
    index = corners @ np.linalg.inv(axes).T
    # Off by an odd share of a voxel, so that no symmetry of the shape is one of the grid.
    low = index.min(axis=0) - [1.3, 1.6, 1.1]
    counts = np.ceil(index.max(axis=0) + 1 - low).astype(int) + 1
    origin_mm = axes @ low
    grid = np.stack(np.meshgrid(*[np.arange(count) for count in counts], indexing="ij"), axis=-1)
    labels = inside((grid @ axes.T + origin_mm).reshape(-1, 3)).reshape(tuple(counts))
    return LabelMap(
        (label * labels).astype(np.int16), voxel_axes(spacing_mm, direction, tuple(origin_mm)), {}
    )


def write_volume(path: Path, label_map: LabelMap, compressed: bool = False) -> Path:
    """Write through SimpleITK, which takes the map to LPS as it is."""
    import SimpleITK

    image = SimpleITK.GetImageFromArray(label_map.labels.transpose(2, 1, 0))
    spacing_mm = label_map.spacing_mm
    image.SetSpacing(spacing_mm.tolist())
    image.SetDirection((label_map.ct_A_voxel[:3, :3] / spacing_mm).reshape(-1).tolist())
    image.SetOrigin(label_map.ct_A_voxel[:3, 3].tolist())
    SimpleITK.WriteImage(image, str(path), compressed)
    return path


def nifti_bytes(
    labels: np.ndarray,
    ras_A_voxel: np.ndarray,
    codes: tuple[int, int],
    order: str = "<",
    qform: np.ndarray | None = None,
    units: int = 2,
) -> bytes:
    """A NIfTI-1 file by hand: uint8 labels (i, j, k), the sform ``ras_A_voxel``, (qform, sform) codes.

    ``qform`` is the other transform, of the same voxel size; ``units`` the code of the length (1 m, 2 mm, 3 um).
    """
    head = bytearray(352)
    spacing_mm = np.linalg.norm(ras_A_voxel[:3, :3], axis=0)
    struct.pack_into(order + "i", head, 0, 348)
    struct.pack_into(order + "8h", head, 40, 3, *labels.shape, 1, 1, 1, 1)
    struct.pack_into(order + "hh", head, 70, 2, 8)
    struct.pack_into(order + "8f", head, 76, 1, *spacing_mm, 0, 0, 0, 0)
    struct.pack_into(order + "f", head, 108, 352)
    struct.pack_into(order + "f", head, 112, 1)
    head[123] = units
    if qform is not None:
        rotation = qform[:3, :3] / np.linalg.norm(qform[:3, :3], axis=0)
        mirror = -1.0 if np.linalg.det(rotation) < 0 else 1.0
        quaternion = Rotation.from_matrix(rotation * [1, 1, mirror]).as_quat(canonical=True)
        struct.pack_into(order + "f", head, 76, mirror)
        struct.pack_into(order + "6f", head, 256, *quaternion[:3], *qform[:3, 3])
    struct.pack_into(order + "hh", head, 252, *codes)
    struct.pack_into(order + "12f", head, 280, *ras_A_voxel[:3].reshape(-1))
    head[344:348] = b"n+1\0"
    return bytes(head) + labels.astype(np.uint8).tobytes(order="F")


def nrrd_bytes(labels: np.ndarray, space: str, ct_A_voxel: np.ndarray, more: str = "") -> bytes:
    """A NRRD file by hand: uint8 labels (i, j, k), its axes' space and directions as given."""
    vectors = " ".join(
        "(" + ",".join(f"{value:.12g}" for value in ct_A_voxel[:3, axis]) + ")" for axis in range(3)
    )
    origin = ",".join(f"{value:.12g}" for value in ct_A_voxel[:3, 3])
    named = f"space: {space}\n" if space else "space dimension: 3\n"
    head = (
        f"NRRD0004\ntype: uint8\ndimension: 3\n{named}sizes: {' '.join(map(str, labels.shape))}\n"
        f"space directions: {vectors}\nspace origin: ({origin})\nencoding: raw\n{more}\n"
    )
    return head.encode() + labels.astype(np.uint8).tobytes(order="F")


def metaimage_bytes(labels: np.ndarray, matrix: str) -> bytes:
    """A MetaImage file by hand: uint8 labels (i, j, k), TransformMatrix as given, spacing 1, at (7, 8, 9) mm."""
    head = (
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
        f"TransformMatrix = {matrix}\nOffset = 7 8 9\nElementSpacing = 1 1 1\n"
        f"DimSize = {' '.join(map(str, labels.shape))}\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    )
    return head.encode() + labels.astype(np.uint8).tobytes(order="F")
