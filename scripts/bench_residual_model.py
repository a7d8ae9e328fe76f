"""Compare the multi-start with and without its model of the residuals on a folder of benchmark cases.

    python scripts/bench_residual_model.py .cache/rigid_benchmark/development [deforming.csv]

Per kind of case: how often a deformation is detected and by which gain, the mean target registration error, the share
of 90 % intervals that hold it, what is accepted and how much of that is off by more than 2 mm, and the time.
A case takes about a second; those that the table already holds are not run again.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pandas as pd

from registration.benchmark.case_files import case_names, read_case, truth_file
from registration.benchmark.cases import BenchmarkCase, CaseTruth
from registration.benchmark.scoring import score_pose
from registration.benchmark.truth_files import read_truth
from registration.rigid import MultiStartICP
from registration.rigid.result import ACCEPTED

MAX_TRE_MM = 2.0
METHODS = {"model": MultiStartICP(), "bootstrap": MultiStartICP(residual_model=None)}


def compared(case: BenchmarkCase, truth: CaseTruth) -> dict[str, object]:
    """One row: both methods on one case."""
    row: dict[str, object] = {"case": case.name, "kind": case.kind}
    for name, method in METHODS.items():
        begin_s = time.process_time()
        result = method(case.moving_mm, case.fixed_mm, None, moving_frame=case.moving_frame)
        low_mm, high_mm = result.tre_interval_mm(truth.targets_mm)
        tre_mm = score_pose(result.fixed_T_moving, truth).tre_mm
        row |= {
            f"{name}_s": time.process_time() - begin_s,
            f"{name}_tre_mm": tre_mm,
            f"{name}_holds": low_mm <= tre_mm <= high_mm,
            f"{name}_high_mm": high_mm,
            f"{name}_accepted": result.verdict == ACCEPTED,
            f"{name}_wrong": result.verdict == ACCEPTED and not tre_mm <= MAX_TRE_MM,
        }
        if result.deformation is not None:
            row |= {"gain": result.deformation.gain, "detected": result.deformation.detected}
            row["probability"] = result.probability_right_vessel
    return row


def main(folder: Path, table: Path | None) -> None:
    """Run all cases and print the means of each kind."""
    rows = pd.read_csv(table).to_dict("records") if table is not None and table.is_file() else []
    done = {row["case"] for row in rows}
    for name in case_names(folder):
        if name in done:
            continue
        rows.append(compared(read_case(folder / name), read_truth(truth_file(folder, name))))
        if table is not None:
            pd.DataFrame(rows).to_csv(table, index=False)
    found = pd.DataFrame(rows)
    numbers = found.drop(columns="case").groupby("kind").mean(numeric_only=False)
    numbers.loc["all"] = found.drop(columns=["case", "kind"]).mean()
    numbers.insert(0, "cases", [*found.groupby("kind").size(), len(found)])
    print(numbers.T.round(2).to_string())


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else None)
