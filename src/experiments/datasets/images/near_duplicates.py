"""Near-identical frames found from the frames themselves, where no data set says which belong together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from experiments.datasets.images.image_similarity import Images, similarity_blocks


@dataclass(frozen=True)
class CrossGroupDuplicates:
    """How similar frames of different groups are.

    Parameters
    ----------
    pairs : ndarray of int, shape (m, 2)
        Indices of near-duplicates of different groups (first < second), whose similarity is above the limit.
    closest : ndarray of int, shape (n,)
        For each frame, the most similar one of another group; -1 where all are of one group.
    similarity : ndarray, shape (n,)
        Similarity to the closest frame; NaN where there is none.
    """

    pairs: Int[np.ndarray, "m 2"]
    closest: Int[np.ndarray, " n"]
    similarity: Float[np.ndarray, " n"]


def near_duplicate_groups(images: Images, limit: float) -> list[int]:
    """Group near-duplicates.

    Parameters
    ----------
    images : sequence of ndarray of uint8, shape (h, w)
        n images, of any sizes.
    limit : float
        Similarity above which two images are near-duplicates (see ``similarity_blocks``).

    Returns
    -------
    list of int
        A group number for each image; near-duplicates of near-duplicates are in one group (connected
        components).
    """
    pairs = [_above(block, limit, start) for start, block in similarity_blocks(images)]
    first, second = np.concatenate(pairs).T
    alike = coo_array((np.ones(len(first), dtype=bool), (first, second)), shape=(len(images),) * 2)
    return [int(label) for label in connected_components(alike, directed=False)[1]]


def near_duplicates_across_groups(
    images: Images, groups: Sequence[str], limit: float
) -> CrossGroupDuplicates:
    """Find near-duplicates, and the closest frame of each, among frames of different groups.

    Parameters
    ----------
    images : sequence of ndarray of uint8, shape (h, w)
        n images, of any sizes.
    groups : sequence of str
        Group of each image.
    limit : float
        Similarity above which two images are near-duplicates (see ``similarity_blocks``).

    Returns
    -------
    CrossGroupDuplicates
        The pairs, and the closest frame of each.
    """
    member = np.unique(np.array(groups), return_inverse=True)[1]
    closest, highest = np.full(len(images), -1), np.full(len(images), np.nan)
    pairs: list[np.ndarray] = [np.zeros((0, 2), dtype=np.int64)]
    for start, block in similarity_blocks(images):
        rows = np.arange(start, start + len(block))
        block[member[rows, None] == member] = -np.inf
        best = block.argmax(axis=1)
        value = block[rows - start, best]
        known = np.isfinite(value)
        closest[rows[known]], highest[rows[known]] = best[known], value[known]
        found = _above(block, limit, start)
        pairs.append(found[found[:, 0] < found[:, 1]])
    return CrossGroupDuplicates(np.concatenate(pairs), closest, highest)


def _above(block: np.ndarray, limit: float, start: int) -> np.ndarray:
    """Row and column in the whole matrix of what is above the limit."""
    found = np.argwhere(block > limit)
    found[:, 0] += start
    return found
