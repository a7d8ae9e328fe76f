"""All chains of transforms between two coordinate frames, which of them counts, and how far the others differ.

A recording and a device set may state different transforms between the same two coordinate frames. PLUS refuses
transforms that close a circle; files of years of use have them. Here the source of a transform decides, and what
contradicts is measured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from registration import transforms
from registration.errors import InputError

# A recording has some ten transforms, most of them to one tracker: chains are few unless its names mean nothing.
_MAX_CHAINS = 2000
_MAX_STEPS = 200_000


@dataclass(frozen=True)
class Link:
    """A transform between two coordinate frames.

    Parameters
    ----------
    source : str
        Coordinate frame that it maps from.
    target : str
        Coordinate frame that it maps to.
    matrix : ndarray, shape (4, 4) or (n, 4, 4)
        Transform, one for all frames of the recording or one for each.
    given : bool, optional
        Whether a setting named it.
    valid : ndarray of bool, shape (n,), optional
        In which frames it was measured, if it differs from frame to frame.
    """

    source: str
    target: str
    matrix: Float64[np.ndarray, "*n 4 4"]
    given: bool = False
    valid: Bool[np.ndarray, " n"] | None = None

    @property
    def name(self) -> str:
        """The transform's name as PLUS writes it."""
        return f"{self.source}To{self.target}"

    @property
    def moving(self) -> bool:
        """Whether it differs from frame to frame."""
        return self.matrix.ndim == 3


@dataclass(frozen=True)
class Chain:
    """Links that lead from one coordinate frame to another one after the other, each forwards or backwards.

    Parameters
    ----------
    source : str
        Coordinate frame that the chain maps from.
    links : tuple of Link
        Links in order.
    """

    source: str
    links: tuple[Link, ...]

    @property
    def matrix(self) -> Float64[np.ndarray, "*n 4 4"]:
        """The transform along the chain, inverting links where needed."""
        chained: np.ndarray = np.eye(4)
        at = self.source
        for link in self.links:
            forward = link.source == at
            matrix = transforms.require_affine(link.matrix, f"{link.name}Transform")
            chained = (matrix if forward else np.linalg.inv(matrix)) @ chained
            at = link.target if forward else link.source
        return chained

    @property
    def given(self) -> bool:
        """Whether any of its links was named by a setting."""
        return any(link.given for link in self.links)

    @property
    def moving(self) -> int:
        """How many of its links differ from frame to frame."""
        return sum(link.moving for link in self.links)

    @property
    def recorded(self) -> int:
        """How many of its links stand in the recording and are the same in every frame."""
        return sum(not link.given and not link.moving for link in self.links)

    @property
    def dead(self) -> bool:
        """Whether one of its links is valid in no frame."""
        return any(link.valid is not None and not link.valid.any() for link in self.links)

    @property
    def text(self) -> str:
        """The names of its links."""
        return ", ".join(link.name + (" (device set)" if link.given else "") for link in self.links)


def calibration_order(chain: Chain) -> tuple[int, ...]:
    """Rank a chain as a calibration: what is named comes first, then what holds for all frames.

    Parameters
    ----------
    chain : Chain
        Chain.

    Returns
    -------
    tuple of int
        Key to sort by; what the recording itself states comes last.
    """
    return (chain.dead, not chain.given, chain.moving, chain.recorded, len(chain.links))


def pose_order(chain: Chain) -> tuple[int, ...]:
    """Rank a chain as poses: what was tracked comes first.

    No constant of a device set replaces a measurement, but one of the recording.

    Parameters
    ----------
    chain : Chain
        Chain.

    Returns
    -------
    tuple of int
        Key to sort by.
    """
    return (chain.dead, not chain.moving, chain.recorded, len(chain.links))


def chains(
    links: Sequence[Link], source: str, target: str, order: Callable[[Chain], tuple[int, ...]]
) -> list[Chain]:
    """Find every chain between two coordinate frames that passes no coordinate frame twice.

    Parameters
    ----------
    links : sequence of Link
        Transforms there are.
    source : str
        Coordinate frame to map from.
    target : str
        Coordinate frame to map to.
    order : callable
        Key of a chain to sort by.

    Returns
    -------
    list of Chain
        Chains, the one that counts first.

    Raises
    ------
    InputError
        If there is none, naming the transforms there are, or more than can be meant.
    """
    found: list[Chain] = []
    for chain in _paths(links, source, target):
        found.append(Chain(source, chain))
        if len(found) > _MAX_CHAINS:
            raise InputError(
                f"transform {source}To{target}: expected a few chains of transforms, found more than {_MAX_CHAINS}"
            )
    if not found:
        known = ", ".join(dict.fromkeys(link.name for link in links)) or "none"
        raise InputError(f"transform {source}To{target}: expected a chain of known transforms, found {known}")
    return sorted(found, key=order)


def _paths(links: Sequence[Link], source: str, target: str) -> Iterator[tuple[Link, ...]]:
    by_frame: dict[str, list[tuple[Link, str]]] = {}
    for link in links:
        by_frame.setdefault(link.source, []).append((link, link.target))
        by_frame.setdefault(link.target, []).append((link, link.source))
    waiting: list[tuple[str, tuple[Link, ...], frozenset[str]]] = [(source, (), frozenset([source]))]
    steps = 0
    while waiting:
        at, passed, seen = waiting.pop()
        steps += 1
        if steps > _MAX_STEPS:
            raise InputError(
                f"transform {source}To{target}: expected a few transforms between frames, found {len(links)}"
            )
        if at == target:
            yield passed
            continue
        for link, beyond in reversed(by_frame.get(at, [])):
            if beyond not in seen:
                waiting.append((beyond, (*passed, link), seen | {beyond}))


def links_from(
    stacks: Mapping[tuple[str, str], tuple[np.ndarray, np.ndarray]],
    given: Mapping[tuple[str, str], np.ndarray],
) -> tuple[Link, ...]:
    """Collect the transforms of a recording and those that a setting named.

    A transform that is the same wherever it is valid counts as one matrix for all frames.

    Parameters
    ----------
    stacks : mapping of (str, str) to (ndarray, ndarray)
        By (from, to), the transforms of a recording, shape (n, 4, 4), and where they are valid, shape (n,).
    given : mapping of (str, str) to ndarray
        By (from, to), the transforms of a setting, shape (4, 4).

    Returns
    -------
    tuple of Link
        All of them.
    """
    found = [Link(*pair, np.asarray(matrix, dtype=np.float64), given=True) for pair, matrix in given.items()]
    for pair, (stack, valid) in stacks.items():
        known = stack[valid]
        if len(known) and (known == known[0]).all():
            found.append(Link(*pair, known[0], valid=valid))
        else:
            found.append(Link(*pair, stack, valid=valid))
    return tuple(found)
