"""Connected components of a 2-D mask, labelled within its bounding box only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from models.array_types import Bool, Shaped
from models.errors import InputError

CONNECTIVITIES = (1, 2)


@dataclass(frozen=True, eq=False)
class Components:
    """Connected components of a mask, numbered by their first pixels, row by row.

    Parameters
    ----------
    labels : ndarray of int, shape (a, b)
        Label of each pixel in the bounding box, from 1; 0 for background.
    count : int
        Number of components.
    box : tuple of slice
        Rows and columns of the mask's bounding box.
    """

    labels: Shaped[np.ndarray, "a b"]
    count: int
    box: tuple[slice, slice]

    @property
    def areas(self) -> np.ndarray:
        """Number of pixels of each label, that of the background first."""
        return np.bincount(self.labels.ravel(), minlength=self.count + 1)


def components(mask: Bool[np.ndarray, "h w"], connectivity: int) -> Components:
    """Label the connected components of a mask.

    Parameters
    ----------
    mask : ndarray of bool, shape (h, w)
        Mask.
    connectivity : int
        1 for pixels that share an edge, 2 for those that share a corner too.

    Returns
    -------
    Components
        The components.
    """
    box = bounding_box(mask)
    labels, count = ndimage.label(mask[box], structure=ndimage.generate_binary_structure(2, connectivity))
    return Components(labels, int(count), box)


def bounding_box(mask: Bool[np.ndarray, "h w"]) -> tuple[slice, slice]:
    """Compute the bounding box of a mask.

    Parameters
    ----------
    mask : ndarray of bool, shape (h, w)
        Mask.

    Returns
    -------
    tuple of slice
        Rows and columns; empty slices for an empty mask.
    """
    rows = np.flatnonzero(mask.any(axis=1))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    columns = np.flatnonzero(mask[rows[0] : rows[-1] + 1].any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def require_connectivity(connectivity: int) -> None:
    """Require a connectivity of 1 or 2.

    Parameters
    ----------
    connectivity : int
        1 for edges, 2 for edges and corners.

    Raises
    ------
    InputError
        If it is another number.
    """
    if connectivity not in CONNECTIVITIES:
        raise InputError(
            f"connectivity: expected 1 (edges) or 2 (edges and corners), received {connectivity}"
        )
