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
    """Transforms by (from, to): the matrix maps coordinates in ``from`` to ``to``, one (4, 4) or a stack (n, 4, 4).

    >>> graph = TransformGraph({("Probe", "Tracker"): np.eye(4), ("Reference", "Tracker"): np.eye(4)})
    >>> graph.chain("Probe", "Reference").shape
    (4, 4)
    """

    edges: Mapping[tuple[str, str], np.ndarray]

    def __post_init__(self) -> None:
        for (source, target), matrix in self.edges.items():
            transforms.require_affine(matrix, f"{source}To{target}Transform")

    def joined(self, other: TransformGraph) -> TransformGraph:
        """Both graphs' transforms; where both have one, that of ``self`` counts."""
        return TransformGraph({**other.edges, **self.edges})

    def path(self, source: str, target: str) -> list[tuple[str, str]]:
        """The links of the shortest chain from ``source`` to ``target``, each as it is stored.

        Raises InputError where the two are not linked, naming the transforms there are.
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
        """The transform from ``source`` to ``target`` along the shortest chain, inverting links where needed."""
        chained: np.ndarray = np.eye(4)
        at = source
        for start, end in self.path(source, target):
            matrix = np.asarray(self.edges[start, end], dtype=np.float64)
            forward = start == at
            chained = (matrix if forward else np.linalg.inv(matrix)) @ chained
            at = end if forward else start
        return chained
