"""The pose of one coordinate frame in another from tf2's tree of transforms, each link with times of its own."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.errors import InputError
from registration.readers.chain.graph import TransformGraph


@dataclass
class TransformTree:
    """Collects links as they are read; ``add`` one by one, then ask for ``poses``.

    A link from child to parent is ``parent_T_child``.

    Parameters
    ----------
    moving : dict, optional
        By (child, parent), times in s and transforms of links that move.
    static : dict, optional
        By (child, parent), transforms that hold at all times.
    broken : collections.Counter, optional
        Messages of each link that held no transform.
    """

    moving: dict[tuple[str, str], list[tuple[float, np.ndarray]]] = field(default_factory=dict)
    static: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)
    broken: Counter[tuple[str, str]] = field(default_factory=Counter)

    def add(self, child: str, parent: str, time_s: float | None, parent_T_child: np.ndarray) -> None:
        """Add what one message states of a link.

        Parameters
        ----------
        child : str
            Coordinate frame that the transform maps from.
        parent : str
            Coordinate frame that it maps to.
        time_s : float or None
            Time in s, None for a static link.
        parent_T_child : ndarray, shape (4, 4)
            Rigid transform in mm.
        """
        pair = _link(child, parent)
        if time_s is None:
            self.static[pair] = parent_T_child
        else:
            self.moving.setdefault(pair, []).append((time_s, parent_T_child))

    def add_broken(self, child: str, parent: str) -> None:
        """Count a message that held no transform for a link.

        Parameters
        ----------
        child : str
            Coordinate frame that the link maps from.
        parent : str
            Coordinate frame that it maps to.
        """
        self.broken[_link(child, parent)] += 1

    def chain_links(self, world: str, ee: str, name: str) -> list[tuple[str, str]]:
        """Find the links of the chain from the end effector to the world.

        Parameters
        ----------
        world : str
            Name of the world.
        ee : str
            Name of the end effector.
        name : str
            Name of the bag, for messages.

        Returns
        -------
        list of (str, str)
            Links in order, as (child, parent).

        Raises
        ------
        InputError
            If a link of the chain is missing.
        """
        known = [*self.moving, *self.static]
        try:
            return TransformGraph(dict.fromkeys(known, np.eye(4))).path(ee.lstrip("/"), world.lstrip("/"))
        except InputError as failure:
            lost = ", ".join(f"{pair[0]} to {pair[1]}" for pair in self.broken if pair not in known)
            hint = f"; without a valid transform: {lost}" if lost else ""
            raise InputError(f"{name}: {failure}{hint}") from failure

    def poses(
        self, world: str, ee: str, max_gap_s: float, name: str
    ) -> tuple[Float64[np.ndarray, " m"], Float64[np.ndarray, "m 4 4"]]:
        """Compose the poses at the times of the chain's most frequent link, the others interpolated to them.

        Times at which another link has no value (outside its own times, or in a gap) are left out: they
        become gaps of the pose stream, which synchronisation sees.

        Parameters
        ----------
        world : str
            Name of the world.
        ee : str
            Name of the end effector.
        max_gap_s : float
            Longest gap of a link in s within which it is interpolated.
        name : str
            Name of the bag, for messages.

        Returns
        -------
        times_s : ndarray, shape (m,)
            Times in s.
        world_T_ee : ndarray, shape (m, 4, 4)
            Rigid poses in mm.

        Raises
        ------
        InputError
            If a link of the chain is missing or does not move, or times of a link run backwards.
        """
        edges = {pair: matrix[-1][1] for pair, matrix in self.moving.items()} | self.static
        links = self.chain_links(world, ee, name)
        moving = [pair for pair in links if pair in self.moving and pair not in self.static]
        if not moving:
            raise InputError(
                f"{name}: expected a moving chain from {ee} to {world}, found static transforms only"
            )
        streams = {pair: _ordered(self.moving[pair], f"{name}: {pair[0]} to {pair[1]}") for pair in moving}
        times_s = streams[max(moving, key=lambda pair: len(streams[pair][0]))][0]
        for known_s, _ in streams.values():
            times_s = times_s[_covered(times_s, known_s, max_gap_s)]
        at_times = {pair: transforms.interpolate(times_s, *stream) for pair, stream in streams.items()}
        chain = TransformGraph({pair: at_times.get(pair, edges[pair]) for pair in links})
        return times_s, np.broadcast_to(
            chain.chain(ee.lstrip("/"), world.lstrip("/")), (len(times_s), 4, 4)
        ).copy()


def _link(child: str, parent: str) -> tuple[str, str]:
    return child.lstrip("/"), parent.lstrip("/")


def _ordered(link: list[tuple[float, np.ndarray]], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and matrices of a link; tf2 may repeat a transform, which is no error, but not run backwards."""
    times_s = np.array([time_s for time_s, _ in link])
    keep = np.concatenate([[True], np.diff(times_s) != 0])
    times_s, matrices = times_s[keep], np.stack([matrix for _, matrix in link])[keep]
    if len(times_s) < 2:
        raise InputError(f"{name}: expected at least two transforms at different times, found {len(times_s)}")
    if (np.diff(times_s) < 0).any():
        raise InputError(
            f"{name}: expected transforms in the order of their times, found times that run backwards"
        )
    return times_s, matrices


def _covered(times_s: np.ndarray, known_s: np.ndarray, max_gap_s: float) -> np.ndarray:
    """Where a link has a value: within its times, and not in a gap that is too long."""
    following = np.clip(np.searchsorted(known_s, times_s), 1, len(known_s) - 1)
    inside = (times_s >= known_s[0]) & (times_s <= known_s[-1])
    at_one = (times_s == known_s[following]) | (times_s == known_s[following - 1])
    return inside & (at_one | (known_s[following] - known_s[following - 1] <= max_gap_s))
