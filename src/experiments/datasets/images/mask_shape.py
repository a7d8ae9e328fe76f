"""What is odd about a mask: several components, holes, contact with the image's edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool
from scipy import ndimage


@dataclass(frozen=True)
class MaskShape:
    """Measures of one mask.

    Parameters
    ----------
    area_px : int
        Number of pixels.
    components : int
        Connected components; pixels that meet at a corner belong together.
    holes : int
        Regions of background that the mask encloses.
    touches_edge : bool
        Whether the mask has a pixel at the image's edge.
    """

    area_px: int
    components: int
    holes: int
    touches_edge: bool


def mask_shape(mask: Bool[np.ndarray, "h w"]) -> MaskShape:
    """Measure a mask.

    Parameters
    ----------
    mask : ndarray of bool, shape (h, w)
        Any mask.

    Returns
    -------
    MaskShape
        Its measures; an empty mask has no component, no hole and no contact with the edge.
    """
    edge = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
    components = ndimage.label(mask, structure=np.ones((3, 3)))[1]
    # The background around the mask is one region of pixels that meet at sides, once a frame of it is added.
    regions = ndimage.label(np.pad(~mask, 1, constant_values=True))[1]
    return MaskShape(int(mask.sum()), int(components), int(regions) - 1, bool(edge.any()))
