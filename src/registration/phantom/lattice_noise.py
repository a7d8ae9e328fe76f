"""Random numbers that belong to a place in the tissue: the same lattice cell always gives the same ones.

Nothing is stored per scatterer, so memory does not grow with the tissue, and any frame can be made on its own.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Integer, UInt32
from scipy.ndimage import gaussian_filter


def hash_cells(
    i: Integer[np.ndarray, " *n"], j: Integer[np.ndarray, " *n"], k: Integer[np.ndarray, " *n"], seed: int
) -> UInt32[np.ndarray, " *n"]:
    """Mix lattice indices and a seed into 32 well-spread bits.

    Parameters
    ----------
    i, j, k : ndarray of int
        Lattice indices, all of one shape.
    seed : int
        Seed; its lowest 32 bits count.

    Returns
    -------
    ndarray of uint32
        Random bits of each cell.

    References
    ----------
    C. Wellons, hash prospector, 2018 (the finaliser).
    """
    mixed = i.astype(np.uint32) * np.uint32(0x9E3779B1)
    mixed = mix(mixed ^ np.uint32(seed & 0xFFFFFFFF))
    mixed = mix(mixed ^ (j.astype(np.uint32) * np.uint32(0x85EBCA77)))
    return mix(mixed ^ (k.astype(np.uint32) * np.uint32(0xC2B2AE3D)))


def mix(bits: UInt32[np.ndarray, " *n"]) -> UInt32[np.ndarray, " *n"]:
    """Spread each input bit over all output bits; different inputs give different outputs.

    Parameters
    ----------
    bits : ndarray of uint32
        Values to mix.

    Returns
    -------
    ndarray of uint32
        Mixed values.
    """
    bits = bits ^ (bits >> np.uint32(16))
    bits = bits * np.uint32(0x7FEB352D)
    bits = bits ^ (bits >> np.uint32(15))
    bits = bits * np.uint32(0x846CA68B)
    return bits ^ (bits >> np.uint32(16))


def smooth_noise(seed: int, cells: int = 64, correlation: float = 3.0) -> Float32[np.ndarray, "c c c"]:
    """Draw a periodic cube of correlated Gaussian noise with zero mean and unit standard deviation.

    Parameters
    ----------
    seed : int
        Seed of the noise.
    cells : int, optional
        Number of cells along each side.
    correlation : float, optional
        Standard deviation of the smoothing in cells.

    Returns
    -------
    ndarray of float32, shape (c, c, c)
        Noise values.
    """
    white = np.random.default_rng(seed).standard_normal((cells, cells, cells), dtype=np.float32)
    smooth = gaussian_filter(white, correlation, mode="wrap")
    smooth -= smooth.mean()
    return np.asarray(smooth / smooth.std(), dtype=np.float32)
