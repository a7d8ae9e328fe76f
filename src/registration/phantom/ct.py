"""The fixed model: what a segmentation finds in a simulated CT of the anatomy, never the mesh that made the images."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32
from scipy.ndimage import gaussian_filter, label

from registration.errors import InputError
from registration.geometry.shapes import Mesh
from registration.phantom.anatomy import Anatomy
from registration.phantom.conditions import CtScan
from registration.phantom.shapes import outward


def fixed_model(anatomy: Anatomy, scan: CtScan, rng: np.random.Generator) -> Mesh:
    """Scan the anatomy, crop, threshold at half the contrast and take the surface of the largest component.

    Cropping cuts ``crop_mm`` off both ends along z; the cut is closed, as segmented models usually are.

    Parameters
    ----------
    anatomy : Anatomy
        Vessel to scan.
    scan : CtScan
        Settings of the CT.
    rng : numpy.random.Generator
        Random stream of the scan.

    Returns
    -------
    Mesh
        Surface in the bed frame in mm.

    Raises
    ------
    InputError
        If the scan shows no vessel, or the crop leaves fewer than 4 slices.
    """
    volume_hu, origin_mm, spacing_mm = scan_volume(anatomy, scan, rng)
    return segment_volume(volume_hu, origin_mm, spacing_mm, 0.5 * scan.contrast_hu)


def segment_volume(
    volume_hu: Float32[np.ndarray, "x y z"],
    origin_mm: Float[np.ndarray, "3"],
    spacing_mm: tuple[float, float, float],
    level_hu: float,
    slices: slice = slice(None),
) -> Mesh:
    """Threshold a volume and take the surface of the largest component.

    Parameters
    ----------
    volume_hu : ndarray of float32, shape (x, y, z)
        Volume in HU.
    origin_mm : ndarray, shape (3,)
        Centre of its first voxel in mm.
    spacing_mm : tuple[float, float, float]
        Size of a voxel in mm.
    level_hu : float
        Threshold in HU.
    slices : slice, optional
        Slices along z that the surface is taken of, of the component that is the largest in the whole volume.

    Returns
    -------
    Mesh
        Surface in the frame of the volume in mm, closed where the slices end.

    Raises
    ------
    InputError
        If nothing exceeds the threshold.
    """
    from skimage.measure import marching_cubes

    pieces, count = label(volume_hu > level_hu)
    if count == 0:
        raise InputError(
            "ct: expected a scan that shows the vessel, received one blurred or cropped to nothing"
        )
    largest = 1 + int(np.bincount(pieces.ravel())[1:].argmax())
    # Marching cubes needs the values around the border, so only other pieces are wiped out.
    others = (pieces > 0) & (pieces != largest)
    padded = np.pad(np.where(others, 0.0, volume_hu)[:, :, slices], 1)
    vertices, triangles, _, _ = marching_cubes(
        padded, level=level_hu, spacing=spacing_mm, gradient_direction="descent"
    )
    first = np.array([-1, -1, slices.indices(volume_hu.shape[2])[0] - 1])
    placed_mm = vertices.astype(np.float64) + origin_mm + first * spacing_mm
    return outward(Mesh(placed_mm, triangles.astype(np.int64)))


def scan_volume(
    anatomy: Anatomy, scan: CtScan, rng: np.random.Generator
) -> tuple[Float32[np.ndarray, "a b c"], Float[np.ndarray, "3"], tuple[float, float, float]]:
    """Simulate a CT of the contrast-filled vessel.

    Each voxel holds the share of it that is vessel (from the distance of its centre to the wall), blurred by
    the scanner's resolution, with noise of the same grain.

    Parameters
    ----------
    anatomy : Anatomy
        Vessel to scan.
    scan : CtScan
        Settings of the CT.
    rng : numpy.random.Generator
        Random stream of the grid's position and of the noise.

    Returns
    -------
    volume_hu : ndarray of float32, shape (a, b, c)
        Values in HU above the surroundings, axes x, y, z.
    origin_mm : ndarray, shape (3,)
        Centre of the first voxel in the bed frame in mm.
    spacing_mm : tuple[float, float, float]
        Voxel size along x, y and z in mm.

    Raises
    ------
    InputError
        If the crop leaves fewer than 4 slices.
    """
    vertices_mm = anatomy.surface.vertices_mm
    spacing_mm = (scan.voxel_mm, scan.voxel_mm, scan.slice_mm)
    border_mm = np.array([4.0, 4.0, -scan.crop_mm])
    shift_mm = rng.random(3) * spacing_mm
    low_mm = vertices_mm.min(axis=0) - border_mm + shift_mm
    counts = np.floor((vertices_mm.max(axis=0) + border_mm - low_mm) / spacing_mm).astype(int) + 1
    if (counts < 4).any():
        raise InputError(f"crop_mm: expected a crop that leaves at least 4 slices, received {scan.crop_mm:g}")
    axes_mm = [low_mm[axis] + spacing_mm[axis] * np.arange(counts[axis]) for axis in range(3)]
    centres_mm = np.stack(np.meshgrid(*axes_mm, indexing="ij"), axis=-1).reshape(-1, 3)
    distance_mm = anatomy.distance.at(centres_mm).reshape(counts)
    filled = np.clip(0.5 - distance_mm / float(np.mean(spacing_mm)), 0.0, 1.0)
    blur = scan.blur_mm / np.array(spacing_mm)
    noise = gaussian_filter(rng.standard_normal(counts), blur)
    noise *= scan.noise_hu / max(float(noise.std()), 1e-9)
    volume_hu = scan.contrast_hu * gaussian_filter(filled, blur, mode="nearest") + noise
    return volume_hu.astype(np.float32), low_mm, spacing_mm
