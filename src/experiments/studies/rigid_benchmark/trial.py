"""One case of the benchmark solved by one method, as a task that any process can run."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import files
from experiments.analysis.registration.pose_scores import plain, read_result, score_result
from registration import transforms
from registration.benchmark.case_files import read_case, truth_file
from registration.benchmark.truth_files import read_truth
from registration.rigid.result import FAILED

if TYPE_CHECKING:
    import numpy as np

    from registration.benchmark.cases import BenchmarkCase
    from registration.rigid.result import RigidResult

LEVEL = 0.9


@dataclass(frozen=True)
class BenchmarkTrial:
    """One method applied to the cases of a subset.

    Parameters
    ----------
    name : str
        Name of the method.
    method : callable
        Rigid registration method.
    folder : Path
        Folder of the subset.
    out : Path
        Folder in which results are left.
    """

    name: str
    method: Callable[..., RigidResult]
    folder: Path
    out: Path

    def __call__(self, case_name: str) -> dict[str, Any]:
        """Solve and score one case; a method that raises has failed.

        The result is left as a file in ``out``.

        Parameters
        ----------
        case_name : str
            Name of the case.

        Returns
        -------
        dict
            Row of the result, as ``study=evaluate`` scores the file.
        """
        case = read_case(self.folder / case_name)
        truth = read_truth(truth_file(self.folder, case_name))
        begin_s = time.perf_counter()
        try:
            result = self.method(
                case.moving_mm, case.fixed_mm, case.initial, moving_frame=case.moving_frame, **_lines(case)
            )
            transforms.require_rigid(result.fixed_T_moving, "fixed_T_moving")
            report = record(result, truth.targets_mm)
        except Exception as failure:  # whatever a method does wrong, the case counts and the others go on
            report = {
                "fixed_T_moving": None,
                "verdict": FAILED,
                "error": f"{type(failure).__name__}: {failure}",
                "runtime_s": time.perf_counter() - begin_s,
            }
        path = self.out / f"{case_name}.json"
        text = json.dumps({"case": case_name, "rigid": self.name, **report}, indent=1, allow_nan=False)
        files.write_text(path, text + "\n")
        return {"method": self.name, **score_result(read_result(path), truth, case)}


def record(result: RigidResult, targets_mm: np.ndarray) -> dict[str, Any]:
    """Make the record of a result under the names that registration.json has.

    The error is predicted at the benchmark's targets, which the method does not see.

    Parameters
    ----------
    result : RigidResult
        Result of the method.
    targets_mm : ndarray, shape (t, 3)
        Targets in the fixed frame in mm.

    Returns
    -------
    dict
        Content, ready for JSON; what is not known is None.
    """
    low_mm, high_mm = result.tre_interval_mm(targets_mm, LEVEL)
    return {
        "fixed_T_moving": result.fixed_T_moving.tolist(),
        "iterations": result.iterations,
        "converged": result.converged,
        "verdict": result.verdict,
        "reason": result.reason,
        "ambiguity_gap": _gap(result.ambiguity_gap),
        "weak_directions": list(result.weak_directions),
        "predicted_tre_mm": {
            "low": plain(low_mm),
            "high": plain(high_mm),
            "level": LEVEL,
            "includes_deformation": result.deformation is not None and result.deformation.is_predicted,
        },
        "deformation": None
        if result.deformation is None
        else {
            "detected": bool(result.deformation.detected),
            "size_mm": plain(result.deformation.size_mm),
            "gain": plain(result.deformation.gain),
        },
        "probability_right_vessel": plain(result.probability_right_vessel),
        "candidates": [
            {
                "fixed_T_moving": one.fixed_T_moving.tolist(),
                "rmse_mm": plain(one.rmse_mm),
                "basin": one.basin,
                "starts": one.starts,
                "stage": one.stage,
            }
            for one in result.candidates
        ],
        "runtime_s": result.runtime_s,
    }


def _lines(case: BenchmarkCase) -> dict[str, np.ndarray]:
    """The centerlines of a case that has them; a method need not know of them for the others."""
    given = {name: getattr(case, name) for name in ("moving_centerline_mm", "fixed_centerline_mm")}
    return {name: line_mm for name, line_mm in given.items() if line_mm is not None}


def _gap(value: float) -> float | str | None:
    """The gap to the next pose; infinite, as text, where there is no other."""
    return "inf" if value == math.inf else plain(value)
