"""Named transforms between frames, and the chain from any frame to any other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.errors import InputError


@dataclass(frozen=True)
class TransformGraph:
    """Transforms between named coordinate frames.

    Parameters
    ----------
    edges : mapping of (str, str) to ndarray
        By (from, to), the matrix that maps coordinates from one to the other, shape (4, 4) or a stack (n, 4,
        4).

    Examples
    --------
    >>> graph = TransformGraph({("Probe", "Tracker"): np.eye(4), ("Reference", "Tracker"): np.eye(4)})
    >>> graph.chain("Probe", "Reference").shape
    (4, 4)
    """

    edges: Mapping[tuple[str, str], np.ndarray]

    def __post_init__(self) -> None:
        for (source, target), matrix in self.edges.items():
            transforms.require_affine(matrix, f"{source}To{target}Transform")

    def joined(self, other: TransformGraph) -> TransformGraph:
        """Join the transforms of two graphs.

        Parameters
        ----------
        other : TransformGraph
            The other graph; where both have a transform, that of ``self`` counts.

        Returns
        -------
        TransformGraph
            Graph with both graphs' transforms.
        """
        return TransformGraph({**other.edges, **self.edges})

    def path(self, source: str, target: str) -> list[tuple[str, str]]:
        """Find the links of the shortest chain between two coordinate frames.

        Parameters
        ----------
        source : str
            Coordinate frame to map from.
        target : str
            Coordinate frame to map to.

        Returns
        -------
        list of (str, str)
            Links in order, each as it is stored.

        Raises
        ------
        InputError
            If the two are not linked, naming the transforms there are.
        """
        reached: dict[str, list[tuple[str, str]]] = {source: []}
        waiting = [source]
        while waiting and target not in reached:
            at = waiting.pop(0)
            for link in self.edges:
                beyond = link[1] if link[0] == at else link[0] if link[1] == at else None
                if beyond is not None and beyond not in reached:
                    reached[beyond] = [*reached[at], link]
                    waiting.append(beyond)
        if target not in reached:
            known = ", ".join(f"{start}To{end}" for start, end in self.edges) or "none"
            raise InputError(
                f"transform {source}To{target}: expected a chain of known transforms, found {known}"
            )
        return reached[target]

    def chain(self, source: str, target: str) -> Float64[np.ndarray, "*n 4 4"]:
        """Compose the transforms along the shortest chain, inverting links where needed.

        Parameters
        ----------
        source : str
            Coordinate frame to map from.
        target : str
            Coordinate frame to map to.

        Returns
        -------
        ndarray, shape (4, 4) or (n, 4, 4)
            Transform from ``source`` to ``target``.
        """
        chained: np.ndarray = np.eye(4)
        at = source
        for start, end in self.path(source, target):
            matrix = np.asarray(self.edges[start, end], dtype=np.float64)
            forward = start == at
            chained = (matrix if forward else np.linalg.inv(matrix)) @ chained
            at = end if forward else start
        return chained
