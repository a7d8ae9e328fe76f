"""Where a NIfTI file's voxels lie: its two transforms, its unit of length, and how many bytes there must be.

After nifti1.h and nifti2.h (NIMH). SimpleITK takes one of the two transforms in silence, and zeros for missing voxels.
"""

from __future__ import annotations

import itertools
import math
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.errors import InputError

# Extensions stand before the voxels: nobody's are longer.
_LATEST_BEGIN = 1 << 28
FORMS = ("qform", "sform")
# Codes of lengths in xyzt_units; 0 is none.
UNITS = {0: "", 1: "m", 2: "mm", 3: "um"}
# Two transforms agree if they put every corner of the volume this close, or within a tenth of a voxel.
_AGREEMENT_MM, _AGREEMENT_VOXELS = 0.1, 0.1
# Bits of a voxel by the code of its type: a reader takes the type's, whatever the header says next to it.
_BITS = {2: 8, 4: 16, 8: 32, 16: 32, 32: 64, 64: 64, 128: 24, 256: 8, 512: 16, 768: 32, 1024: 64, 1280: 64}
_BITS |= {1536: 128, 1792: 128, 2048: 256, 2304: 32}


@dataclass(frozen=True)
class _Layout:
    """Where a version of the format has its fields, as struct formats and places."""

    dim: tuple[str, int]
    kind: tuple[str, int]
    bits: tuple[str, int]
    pixdim: tuple[str, int]
    begin: tuple[str, int]
    codes: tuple[str, int]
    quaternion: tuple[str, int]
    rows: tuple[str, int]
    units: tuple[str, int]


_LAYOUTS = {
    348: _Layout(
        ("8h", 40),
        ("h", 70),
        ("h", 72),
        ("8f", 76),
        ("f", 108),
        ("2h", 252),
        ("6f", 256),
        ("12f", 280),
        ("b", 123),
    ),
    540: _Layout(
        ("8q", 16),
        ("h", 12),
        ("h", 14),
        ("8d", 104),
        ("q", 168),
        ("2i", 344),
        ("6d", 352),
        ("12d", 400),
        ("i", 500),
    ),
}


@dataclass(frozen=True)
class NiftiHeader:
    """The part of a NIfTI header on the size of the file and the place of its voxels.

    Parameters
    ----------
    sizes : tuple of int
        Sizes of the axes.
    bytes : int
        Number of bytes that the file must have.
    spacing : tuple of float
        Distances of voxels along the three axes in the file's unit.
    qform : ndarray, shape (4, 4), or None
        Transform from voxel to RAS in the file's unit; None where its code is 0, which is no transform.
    sform : ndarray, shape (4, 4), or None
        The same for the second transform.
    units : str
        Unit of length: m, mm, um, or empty.
    code_places : tuple of int
        Offsets of both codes in the file in bytes.
    code_format : str
        Format of both codes for ``struct``.
    """

    sizes: tuple[int, ...]
    bytes: int
    spacing: tuple[float, float, float]
    qform: Float64[np.ndarray, "4 4"] | None
    sform: Float64[np.ndarray, "4 4"] | None
    units: str
    code_places: tuple[int, int]
    code_format: str

    def ras_A_voxel(
        self, form: str | None, unit_mm: float, path: Path
    ) -> tuple[str, Float64[np.ndarray, "4 4"]]:
        """Choose the transform that counts.

        Parameters
        ----------
        form : {'qform', 'sform'} or None
            Choice; without one the two must agree.
        unit_mm : float
            Millimetres in the file's unit.
        path : Path
            Name of the file, for messages.

        Returns
        -------
        form : str
            Name of the transform, empty where the file has none.
        ras_A_voxel : ndarray, shape (4, 4)
            Transform in mm.

        Raises
        ------
        InputError
            If the two differ without a choice, or the chosen one is not there.
        """
        there = {
            name: matrix
            for name, matrix in (("sform", self.sform), ("qform", self.qform))
            if matrix is not None
        }
        to_mm = np.diag([unit_mm, unit_mm, unit_mm, 1.0])
        if form is not None and form not in there:
            raise InputError(
                f"nifti_form: expected {' or '.join(there) or 'none'}, as {path} has it, received {form}"
            )
        for name in [form] if form else there:
            transforms.require_affine(there[name], f"{path}: {name}")
        if len(there) == 2 and form is None:
            self._require_agreement(to_mm, path)
        if not there:
            alone = transforms.require_affine(np.diag([*self.spacing, 1.0]), f"{path}: pixdim")
            return "", to_mm @ alone
        name = form or next(iter(there))
        return name, to_mm @ there[name]

    def _require_agreement(self, to_mm: Float64[np.ndarray, "4 4"], path: Path) -> None:
        assert self.qform is not None
        assert self.sform is not None
        sizes = (*self.sizes, 1, 1)[:3]
        corners = np.array(list(itertools.product(*[(0, size - 1) for size in sizes])), dtype=np.float64)
        apart = transforms.apply(to_mm @ self.qform, corners) - transforms.apply(to_mm @ self.sform, corners)
        apart_mm = float(np.linalg.norm(apart, axis=1).max())
        voxel_mm = float(np.linalg.norm((to_mm @ self.qform)[:3, :3], axis=0).min())
        if not apart_mm <= max(_AGREEMENT_MM, _AGREEMENT_VOXELS * voxel_mm):
            raise InputError(
                f"{path}: expected qform and sform that agree, found voxels up to {apart_mm:.4g} mm apart "
                "(nifti_form=qform or nifti_form=sform chooses)"
            )


def read_nifti_header(path: Path, named: Path) -> NiftiHeader:
    """Read the header of an unpacked NIfTI file.

    Parameters
    ----------
    path : Path
        Unpacked file.
    named : Path
        File that the user knows, for messages.

    Returns
    -------
    NiftiHeader
        Sizes and transforms.

    Raises
    ------
    InputError
        If this is no NIfTI header, is cut short, or contradicts itself.
    """
    with path.open("rb") as stream:
        head = stream.read(544)
    for order, (size, layout) in itertools.product("<>", _LAYOUTS.items()):
        if head[:4] == struct.pack(order + "i", size) and len(head) >= min(size, 544):
            return _header(head, order, layout, named)
    raise InputError(f"{named}: expected the header of a NIfTI volume, received another file")


def _header(head: bytes, order: str, layout: _Layout, named: Path) -> NiftiHeader:
    def at(place: tuple[str, int]) -> tuple[float, ...]:
        return struct.unpack_from(order + place[0], head, place[1])

    dim, pixdim, codes = at(layout.dim), at(layout.pixdim), at(layout.codes)
    sizes = tuple(int(size) for size in dim[1 : 1 + max(int(dim[0]), 0)])
    if not 1 <= dim[0] <= 7 or min(sizes) < 1:
        raise InputError(
            f"{named}: expected 1 to 7 axes of one voxel at least, found {list(map(int, dim))} in dim"
        )
    kind, bits, begin = int(at(layout.kind)[0]), int(at(layout.bits)[0]), at(layout.begin)[0]
    if _BITS.get(kind) != bits or not 0 <= begin < _LATEST_BEGIN:
        raise InputError(
            f"{named}: expected a known type of voxels, its bits and their first byte, found type {kind}, "
            f"{bits} bits, from byte {begin:g} on"
        )
    unit = int(at(layout.units)[0]) & 7
    if unit not in UNITS:
        raise InputError(f"{named}: expected a length in m, mm or um, found code {unit} in xyzt_units")
    sform = np.eye(4)
    sform[:3] = np.array(at(layout.rows)).reshape(3, 4)
    code_format, first = layout.codes[0].removeprefix("2"), layout.codes[1]
    return NiftiHeader(
        sizes=sizes,
        bytes=int(begin) + math.prod(sizes) * bits // 8,
        spacing=(float(pixdim[1]), float(pixdim[2]), float(pixdim[3])),
        qform=_qform(at(layout.quaternion), pixdim) if codes[0] > 0 else None,
        sform=sform if codes[1] > 0 else None,
        units=UNITS[unit],
        code_places=(first, first + struct.calcsize(code_format)),
        code_format=order + code_format,
    )


def _qform(values: tuple[float, ...], pixdim: tuple[float, ...]) -> Float64[np.ndarray, "4 4"]:
    """Rotation by a quaternion without its first part, then the voxels' size; pixdim[0] = -1 mirrors the third axis."""
    b, c, d = values[:3]
    a = math.sqrt(max(0.0, 1.0 - b * b - c * c - d * d))
    rotation = np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ]
    )
    mirror = -1.0 if pixdim[0] < 0 else 1.0
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array([pixdim[1], pixdim[2], mirror * pixdim[3]])
    matrix[:3, 3] = values[3:6]
    return matrix
