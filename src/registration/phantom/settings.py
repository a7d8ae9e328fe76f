"""All that decides a simulated phantom, as one value with one digest."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import zlib
from dataclasses import dataclass, field
from pathlib import Path

from registration.checks import require_count
from registration.errors import InputError
from registration.phantom.acoustics import Artefacts, Scanner, Tissue
from registration.phantom.conditions import CtScan, Deformation, Motion

SUBSETS = ("artificial", "vein", "artery")
# Two more kinds of vessel, chosen by the same setting: drawn at random by a seed, and a user's own surface.
RANDOM, MESH = "random", "mesh"


@dataclass(frozen=True)
class PhantomSettings:
    """Settings of one simulated phantom.

    Parameters
    ----------
    subset : {"artificial", "vein", "artery", "random", "mesh"}, optional
        Kind of vessel: a design, an anatomy drawn by ``anatomy_seed``, or the user's ``mesh``.
    seed : int, optional
        Seed of all that is random about the phantom and its sweeps.
    anatomy_seed : int, optional
        Seed of a random anatomy: below 1000 for development, from 1000 for tests.
    mesh : str, optional
        Path of a closed surface in mm; where given, ``subset`` becomes ``mesh``. Empty for none.
    scanner : Scanner, optional
        Probe and scanner.
    tissue : Tissue, optional
        Acoustic properties of the tissue.
    artefacts : Artefacts, optional
        Artefacts.
    motion : Motion, optional
        Motion of the probe.
    deformation : Deformation, optional
        Deformation of the tissue.
    ct : CtScan, optional
        Preoperative CT.

    Raises
    ------
    InputError
        If the kind is unknown, a seed is negative, the mesh is missing, or a part has the wrong type.
    """

    subset: str = "artery"
    seed: int = 0
    anatomy_seed: int = 0
    mesh: str | Path = ""
    scanner: Scanner = field(default_factory=Scanner)
    tissue: Tissue = field(default_factory=Tissue)
    artefacts: Artefacts = field(default_factory=Artefacts)
    motion: Motion = field(default_factory=Motion)
    deformation: Deformation = field(default_factory=Deformation)
    ct: CtScan = field(default_factory=CtScan)

    def __post_init__(self) -> None:
        if self.mesh:
            object.__setattr__(self, "subset", MESH)
        known = (*SUBSETS, RANDOM, MESH)
        if self.subset not in known:
            raise InputError(f"subset: expected one of {', '.join(known)}, received {self.subset!r}")
        require_count("seed", self.seed, 0)
        require_count("anatomy_seed", self.anatomy_seed, 0)
        if self.subset == MESH and not self.mesh:
            raise InputError("mesh: expected the file of a closed surface with subset=mesh, received none")
        for name, kind in PARTS.items():
            if not isinstance(getattr(self, name), kind):
                found = type(getattr(self, name)).__name__
                raise InputError(f"{name}: expected a {kind.__name__}, received a {found}")

    @property
    def entropy(self) -> tuple[int, int]:
        """Seed and kind of vessel as numbers: phantoms of one seed do not share their tissue."""
        return self.seed, zlib.crc32(f"{self.subset} {self.anatomy_seed}".encode())

    def digest(self) -> str:
        """Compute the SHA-256 of all settings, and of the bytes of the mesh file where there is one.

        Returns
        -------
        str
            64 hexadecimal digits.
        """
        text = json.dumps(dataclasses.asdict(self), sort_keys=True, default=str)
        content = Path(self.mesh).read_bytes() if self.mesh else b""
        return hashlib.sha256(text.encode() + content).hexdigest()


PARTS: dict[str, type] = {
    "scanner": Scanner,
    "tissue": Tissue,
    "artefacts": Artefacts,
    "motion": Motion,
    "deformation": Deformation,
    "ct": CtScan,
}
