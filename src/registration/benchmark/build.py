"""Building the cases: points of a sweep and of the model from CT, and a random start for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration import transforms
from registration.benchmark.cases import BenchmarkCase, CaseTruth
from registration.benchmark.initial_offset import draw_points, draw_start
from registration.benchmark.scenarios import KINDS, kind_named
from registration.benchmark.sweep_simulation import swept
from registration.benchmark.symmetric_shapes import SHAPES
from registration.errors import InputError

DEVELOPMENT, TEST, SYMMETRIC = SUBSETS = ("development", "test", "symmetric")
ANATOMIES = {DEVELOPMENT: range(24), TEST: range(1000, 1024)}
# Seeds of the symmetric shapes, beyond those of all random anatomies.
SYMMETRIC_SEED = 5000
MOVING_POINTS, FIXED_POINTS = 3000, 5000


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
    """

    anatomy: str
    seed: int
    kind: str

    @property
    def name(self) -> str:
        """Name of the case in files and tables."""
        return f"{self.anatomy}_{self.kind}"


def specs(subset: str) -> tuple[CaseSpec, ...]:
    """List all cases of a subset.

    Parameters
    ----------
    subset : str
        ``development`` (anatomy seeds 0 to 23), ``test`` (1000 to 1023) or ``symmetric``.

    Returns
    -------
    tuple of CaseSpec
        The cases, in a fixed order.

    Raises
    ------
    InputError
        If the subset is unknown.
    """
    if subset == SYMMETRIC:
        return tuple(
            CaseSpec(name, SYMMETRIC_SEED + number, kind)
            for number, (name, (_, kinds)) in enumerate(SHAPES.items())
            for kind in kinds
        )
    if subset not in ANATOMIES:
        raise InputError(f"subset: expected one of {', '.join(SUBSETS)}, received {subset!r}")
    return tuple(
        CaseSpec(f"random{seed:04d}", seed, kind.name) for seed in ANATOMIES[subset] for kind in KINDS
    )


def build_case(spec: CaseSpec) -> tuple[BenchmarkCase, CaseTruth]:
    """Make one case and its truth in memory, in half a second to two.

    Parameters
    ----------
    spec : CaseSpec
        Which case.

    Returns
    -------
    case : BenchmarkCase
        What a method is given.
    truth : CaseTruth
        Pose, targets and symmetry of the case.

    Raises
    ------
    InputError
        If the kind is unknown.
    """
    kind = kind_named(spec.kind)
    number = KINDS.index(kind)
    rng = np.random.default_rng([spec.seed, 60, number])
    found = swept(spec.anatomy, spec.seed, number, kind, rng)
    model = found.sweep.model
    drawn = draw_points(found.cloud_mm, MOVING_POINTS, kind.outlier_share, rng)
    start = draw_start(drawn.points_mm, rng)
    moving_T_world = transforms.compose(start.moved_T_true, found.sweep.ct_T_world)
    case = BenchmarkCase(
        name=spec.name,
        anatomy=spec.anatomy,
        kind=spec.kind,
        moving_mm=transforms.apply(start.moved_T_true, drawn.points_mm),
        moving_normals=found.cloud.normals[drawn.index] @ moving_T_world[:3, :3].T,
        moving_frame=found.cloud.frame_index[drawn.index],
        fixed=model,
        fixed_mm=model.sample(FIXED_POINTS, rng),
    )
    truth = CaseTruth(
        name=spec.name,
        anatomy=spec.anatomy,
        kind=spec.kind,
        place=found.place,
        fixed_T_moving=transforms.invert_rigid(start.moved_T_true),
        targets_mm=found.targets_mm,
        covered=found.covered,
        outlier=drawn.outlier,
        angle_deg=start.angle_deg,
        translation_mm=start.translation_mm,
        symmetry=found.symmetry,
    )
    return case, truth
