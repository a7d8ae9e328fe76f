"""Small benchmark cases whose tissue moves by a known smooth displacement, drawn by formula."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from benchmark_cases import drawn_case

from registration import transforms
from registration.benchmark.case_files import write_case
from registration.benchmark.cases import BenchmarkCase, CaseTruth

NAMES = {"tube_a": "a", "tube_b": "b", "tube_c": "c"}


def sway(points_mm: np.ndarray) -> np.ndarray:
    """Displacement in mm of material of the model at points of the fixed frame."""
    return np.column_stack(
        [
            2.0 * np.sin(points_mm[:, 2] / 12.0),
            1.5 * np.cos(points_mm[:, 0] / 15.0),
            0.1 * points_mm[:, 1],
        ]
    )


def deforming_case(name: str, anatomy: str, seed: int = 0) -> tuple[BenchmarkCase, CaseTruth]:
    """A drawn case whose swept points are displaced by ``sway``."""
    case, truth = drawn_case(name, anatomy, "sway", seed)
    there_mm = transforms.apply(truth.fixed_T_moving, case.moving_mm)
    swept_mm = transforms.apply(transforms.invert_rigid(truth.fixed_T_moving), there_mm + sway(there_mm))
    return replace(case, moving_mm=swept_mm), replace(
        truth, block="deforming", displacement_mm=sway(truth.targets_mm)
    )


def written_deforming_cases(folder: Path) -> dict[str, tuple[BenchmarkCase, CaseTruth]]:
    """Write three cases of three anatomies into a subset's folder."""
    made = {name: deforming_case(name, anatomy, seed) for seed, (name, anatomy) in enumerate(NAMES.items())}
    for case, truth in made.values():
        write_case(folder, case, truth)
    return made
