"""The blocks of the benchmark, and the cases of each: what is tried besides rigid sweeps of the right vessel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from registration.benchmark.cases import UNDEFORMED
from registration.benchmark.scenarios import KINDS
from registration.benchmark.symmetric_shapes import SHAPES
from registration.errors import InputError

DEVELOPMENT, TEST, SYMMETRIC = SUBSETS = ("development", "test", "symmetric")
DEFORMING, WRONG_VESSEL, OVERLAP, NOISE = "deforming", "wrong_vessel", "overlap", "noise"
BLOCKS = (UNDEFORMED, DEFORMING, WRONG_VESSEL, OVERLAP, NOISE)
ANATOMIES = {DEVELOPMENT: range(24), TEST: range(1000, 1024)}
# The other blocks have anatomies that no method was developed on while there was but one block.
OTHER_ANATOMIES = {DEVELOPMENT: range(100, 124), TEST: range(1100, 1124)}
# Seeds of the symmetric shapes, beyond those of all random anatomies.
SYMMETRIC_SEED = 5000
MOTIONS = ("press", "bend", "indentation", "field")
SIZES_MM = {"small": 1.5, "medium": 2.0, "large": 4.0}
DESIGNED = ("artery", "vein")
# Blocks of fewer anatomies than there are: every case takes seconds to make.
FEWER = {DEFORMING: 12, WRONG_VESSEL: 20, OVERLAP: 12, NOISE: 12}
KIND_NAMES = {
    UNDEFORMED: tuple(kind.name for kind in KINDS),
    DEFORMING: tuple(f"{motion}_{size}" for motion in MOTIONS for size in SIZES_MM),
    WRONG_VESSEL: (
        "other_whole",
        "other_piece40",
        "mirror_whole",
        "mirror_piece40",
        "own_piece40_end",
        "own_piece40_middle",
    ),
    OVERLAP: ("common40", "common50", "common50_started", "common60"),
    NOISE: ("moving_noise", "both_noise"),
}
# A wrong model is that of an anatomy so many places further in the list.
WRONG_STEPS = (1, 7)


@dataclass(frozen=True)
class CaseSpec:
    """Specification of one case: an anatomy and a kind; the same spec always gives the same case.

    Parameters
    ----------
    anatomy : str
        Name of the anatomy.
    seed : int
        Seed of the anatomy.
    kind : str
        Name of the kind of case.
    block : str, optional
        Block that the case belongs to.
    model_seed : int or None, optional
        Seed of the anatomy whose model is the fixed side; None for that of the sweep.
    """

    anatomy: str
    seed: int
    kind: str
    block: str = UNDEFORMED
    model_seed: int | None = None

    @property
    def name(self) -> str:
        """Name of the case in files and tables."""
        other = "" if self.model_seed is None else f"_{self.model_seed:04d}"
        return f"{self.anatomy}_{self.kind}{other}"


def blocks_of(subset: str) -> tuple[str, ...]:
    """List the blocks of a subset: of the symmetric shapes there is but the undeformed one.

    Parameters
    ----------
    subset : str
        ``development``, ``test`` or ``symmetric``.

    Returns
    -------
    tuple of str
        Names.
    """
    return (UNDEFORMED,) if subset == SYMMETRIC else BLOCKS


def collection_name(subset: str, block: str = UNDEFORMED) -> str:
    """Return the name under which a block of a subset is kept.

    Parameters
    ----------
    subset : str
        ``development``, ``test`` or ``symmetric``.
    block : str, optional
        Name of the block.

    Returns
    -------
    str
        Name of its folder and key of its digests.

    Raises
    ------
    InputError
        If there is no such subset or block.
    """
    if subset not in SUBSETS:
        raise InputError(f"subset: expected one of {', '.join(SUBSETS)}, received {subset!r}")
    known = blocks_of(subset)
    if block not in known:
        raise InputError(f"blocks: expected some of {', '.join(known)} with {subset}, received {block!r}")
    return subset if block == UNDEFORMED else f"{subset}_{block}"


def specs(subset: str, block: str = UNDEFORMED) -> tuple[CaseSpec, ...]:
    """List all cases of a block.

    Parameters
    ----------
    subset : str
        ``development`` (anatomy seeds below 1000), ``test`` (from 1000) or ``symmetric``.
    block : str, optional
        Name of the block.

    Returns
    -------
    tuple of CaseSpec
        The cases, in a fixed order.

    Raises
    ------
    InputError
        If the subset or the block is unknown.
    """
    collection_name(subset, block)
    if subset == SYMMETRIC:
        return tuple(
            CaseSpec(name, SYMMETRIC_SEED + number, kind)
            for number, (name, (_, kinds)) in enumerate(SHAPES.items())
            for kind in kinds
        )
    if block == UNDEFORMED:
        return tuple(_random(seed, kind.name) for seed in ANATOMIES[subset] for kind in KINDS)
    return tuple(_LISTED[block](OTHER_ANATOMIES[subset]))


def _random(seed: int, kind: str, block: str = UNDEFORMED, model_seed: int | None = None) -> CaseSpec:
    return CaseSpec(f"random{seed:04d}", seed, kind, block, model_seed)


def _deforming(seeds: range) -> Iterator[CaseSpec]:
    """Anatomies in four motions each; the sizes go round, so that every motion comes in all of them."""
    sizes = tuple(SIZES_MM)
    for seed in seeds[: FEWER[DEFORMING]]:
        for number, motion in enumerate(MOTIONS):
            yield _random(seed, f"{motion}_{sizes[(seed + number) % len(sizes)]}", DEFORMING)
    for place, name in enumerate(DESIGNED):
        for number, motion in enumerate(MOTIONS):
            kind = f"{motion}_{sizes[(place + number) % len(sizes)]}"
            yield CaseSpec(name, seeds[number], kind, DEFORMING)


def _wrong_vessel(seeds: range) -> Iterator[CaseSpec]:
    for number, seed in enumerate(seeds[: FEWER[WRONG_VESSEL]]):
        others = [seeds[(number + step) % len(seeds)] for step in WRONG_STEPS]
        yield _random(seed, "other_whole", WRONG_VESSEL, others[0])
        for other in others:
            yield _random(seed, "other_piece40", WRONG_VESSEL, other)
        for kind in KIND_NAMES[WRONG_VESSEL][2:]:
            yield _random(seed, kind, WRONG_VESSEL)


def _overlap(seeds: range) -> Iterator[CaseSpec]:
    for number, seed in enumerate(seeds[: FEWER[OVERLAP]]):
        for kind in ("common50", "common50_started", "common40" if number % 2 else "common60"):
            yield _random(seed, kind, OVERLAP)


def _noise(seeds: range) -> Iterator[CaseSpec]:
    for seed in seeds[: FEWER[NOISE]]:
        for kind in KIND_NAMES[NOISE]:
            yield _random(seed, kind, NOISE)


_LISTED = {DEFORMING: _deforming, WRONG_VESSEL: _wrong_vessel, OVERLAP: _overlap, NOISE: _noise}
