"""Compare the multi-start with and without its model of the residuals on a folder of benchmark cases.

    python scripts/bench_residual_model.py --subset test --block deforming
    python scripts/bench_residual_model.py .cache/rigid_benchmark/development

Per kind of case: how often a deformation is detected and by which gain, the mean target registration error, the share
of 90 % intervals that hold it, what is accepted and how much of that is off by more than 2 mm, and the time.
A case takes one or two seconds, and some more to make.
"""

from __future__ import annotations

import os

# Read by the numerical libraries when they are imported: one core for both.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
from quick_budget import parsed

from registration.benchmark.blocks import BLOCKS, SUBSETS, specs
from registration.benchmark.build import build_case
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


def cases(given: argparse.Namespace) -> Iterator[tuple[BenchmarkCase, CaseTruth]]:
    """Cases of a folder, or of a block as they are made."""
    if given.folder is not None:
        for name in case_names(given.folder):
            yield read_case(given.folder / name), read_truth(truth_file(given.folder, name))
        return
    for spec in specs(given.subset, given.block)[: given.cases]:
        yield build_case(spec)


def main() -> None:
    """Run all cases and print the means of each kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, help="cases on disk; without it a block is made")
    parser.add_argument("--subset", default="development", choices=SUBSETS)
    parser.add_argument("--block", default="deforming", choices=BLOCKS)
    parser.add_argument("--cases", type=int, help="only so many of the block")
    parsed_arguments = parsed(parser, {"cases": 2})
    found = pd.DataFrame([compared(case, truth) for case, truth in cases(parsed_arguments)])
    numbers = found.drop(columns="case").groupby("kind").mean(numeric_only=False)
    numbers.loc["all"] = found.drop(columns=["case", "kind"]).mean()
    numbers.insert(0, "cases", [*found.groupby("kind").size(), len(found)])
    print(numbers.T.round(2).to_string())


if __name__ == "__main__":
    main()
