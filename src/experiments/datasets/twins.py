"""Near-identical frames found from the frames themselves, where no data set says which belong together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image
from scipy.sparse.csgraph import connected_components

# Small enough that speckle averages out, large enough that anatomy remains.
THUMBNAIL_PX = 48


def twin_groups(images: Sequence[UInt8[np.ndarray, "h w"]], correlation: float) -> list[int]:
    """A group number for each image: two whose thumbnails correlate above ``correlation`` share one, and so on.

    Thumbnails are 48x48; twins of twins fall in one group (connected components).
    """
    alike = correlations(images) > correlation
    return [int(label) for label in connected_components(alike, directed=False)[1]]


def correlations(images: Sequence[UInt8[np.ndarray, "h w"]]) -> Float[np.ndarray, "n n"]:
    """Pearson's correlation of each pair of thumbnails; 0 for a uniform one."""
    size = (THUMBNAIL_PX, THUMBNAIL_PX)
    small = [np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BILINEAR)) for image in images]
    values = np.stack(small).reshape(len(images), -1).astype(np.float64)
    values -= values.mean(axis=1, keepdims=True)
    norms = np.linalg.norm(values, axis=1, keepdims=True)
    values /= np.where(norms > 0, norms, 1)
    return values @ values.T
