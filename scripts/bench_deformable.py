"""Error of material points by the rigid result and after deformable registration, on the benchmark's simulated sweeps.

The rigid pose is the multi-start's. Each method then displaces the model onto the swept points; a target's error is its
distance from where its material was swept. Cases whose rigid pose is no start (more than 5 mm off the true rigid one)
are left out and counted. Intervals: how many of the predicted 90 % intervals hold the RMS error of the targets.
Development seeds chose the parameters; quote the test seeds.

    python scripts/bench_deformable.py --blocks deforming --methods plane --entries mine
    ctus study=evaluate prediction=mine/test_deforming reference=.cache/rigid_benchmark/test_deforming out=scored

writes what a method enters in the benchmark, a pose and a displacement a case, and has it scored from these files.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from quick_budget import REPOSITORY, parsed

from experiments.analysis.registration.benchmark.cases import block_specs, make_cases
from experiments.running.terminal import TerminalProgress
from registration import transforms
from registration.benchmark.case_files import read_case, truth_file
from registration.benchmark.cases import UNDEFORMED
from registration.benchmark.deformable_entries import write_entry
from registration.benchmark.scoring import material_error_mm
from registration.benchmark.truth_files import read_truth
from registration.cpd import CoherentPointDrift
from registration.metrics.surface_distance import pose_error, rms
from registration.rigid import MultiStartICP

CACHE = REPOSITORY / ".cache" / "rigid_benchmark"
NO_START_MM = 5.0
METHODS = {"plane": CoherentPointDrift(), "point": CoherentPointDrift("point")}
LOSS_MM = 0.05


def scored(
    folder: Path, names: list[str], methods: list[str], entries: Path | None = None
) -> Iterator[dict[str, Any]]:
    """A row for each case and method, the rigid result first; entries are those of the first method."""
    for name in names:
        case, truth = read_case(folder / name), read_truth(truth_file(folder, name))
        rigid = MultiStartICP()(case.moving_mm, case.fixed_mm, moving_frame=case.moving_frame)
        pose = rigid.fixed_T_moving
        if pose_error(pose, truth.fixed_T_moving, truth.targets_mm).tre_mm > NO_START_MM:
            if entries:
                write_entry(entries, name, pose, np.zeros_like, case.fixed_mm)
            yield {"case": name, "method": "rigid"}
            continue
        errors_mm = material_error_mm(pose, truth)
        yield {"case": name, "method": "rigid", **_errors(errors_mm, truth.covered)}
        swept_mm = transforms.apply(pose, case.moving_mm)
        for method in methods:
            begun = time.perf_counter()
            found = METHODS[method](case.fixed_mm, swept_mm, fixed_frame=case.moving_frame)
            seconds = time.perf_counter() - begun
            if entries and method == methods[0]:
                write_entry(entries, name, pose, found.displacement, case.fixed_mm)
            errors_mm = material_error_mm(pose, truth, found.displacement(truth.targets_mm))
            row = {"case": name, "method": method, **_errors(errors_mm, truth.covered), "seconds": seconds}
            for part, chosen in (("covered", truth.covered), ("uncovered", ~truth.covered)):
                if chosen.any():
                    low_mm, high_mm = found.tre_interval_mm(truth.targets_mm[chosen])
                    row[f"holds_{part}"] = (
                        float(low_mm <= row[part] <= high_mm) if np.isfinite(high_mm) else np.nan
                    )
            yield {**row, "rmse_mm": found.rmse_mm, "verdict": found.verdict}


def _errors(errors_mm: np.ndarray, covered: np.ndarray) -> dict[str, float]:
    return {
        "covered": rms(errors_mm[covered]) if covered.any() else np.nan,
        "uncovered": rms(errors_mm[~covered]) if (~covered).any() else np.nan,
    }


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row for each method: mean errors, what they are below the rigid ones, and in how many cases."""
    rigid = rows[rows["method"] == "rigid"].set_index("case").dropna(subset=["covered"])
    found = []
    for method, own in rows.groupby("method", sort=False):
        cases = own.set_index("case").reindex(rigid.index)
        line: dict[str, Any] = {"method": method, "cases": len(cases)}
        for part in ("covered", "uncovered"):
            before, after = rigid[part].dropna(), cases[part].reindex(rigid[part].dropna().index)
            line |= {f"{part}_mm": after.mean(), f"{part}_below_%": 100 * (1 - after.mean() / before.mean())}
            line |= {f"{part}_better": f"{int((after < before).sum())}/{len(before)}"}
            if f"holds_{part}" in cases and method != "rigid":
                holds = cases[f"holds_{part}"].dropna()
                line[f"{part}_holds"] = f"{int(holds.sum())}/{len(holds)}"
        if method != "rigid":
            lost = (cases["covered"] - rigid["covered"]).clip(lower=0)
            line |= {f"lost_over_{LOSS_MM}": int((lost > LOSS_MM).sum()), "rmse_mm": cases["rmse_mm"].mean()}
            line |= {
                "rigid_stands": int((cases["verdict"] == "rigid stands").sum()),
                "seconds": statistics.median(cases["seconds"]),
            }
        found.append(line)
    return pd.DataFrame(found)


def main() -> None:
    """Make the cases that are missing, register them and print a table for each block."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--subset", default="test", help="development or test")
    parser.add_argument("--methods", default="plane,point", help="of plane, point")
    parser.add_argument("--blocks", default="deforming,undeformed", help="of deforming, undeformed")
    parser.add_argument("--cases", type=int, help="only so many of each block")
    parser.add_argument("--entries", type=Path, help="folder to write entries to, a folder of each block")
    parser.add_argument("--workers", type=int, default=2, help="processes that make cases")
    given = parsed(parser, {"cases": 1, "subset": "development", "methods": "plane"})
    for block in given.blocks.split(","):
        folder = given.subset if block == UNDEFORMED else f"{given.subset}_{block}"
        wanted = block_specs(given.subset, block)[: given.cases]
        make_cases(CACHE / folder, wanted, given.workers, TerminalProgress(), folder)
        names = [spec.name for spec in wanted]
        entries = given.entries and given.entries / folder
        rows = pd.DataFrame(list(scored(CACHE / folder, names, given.methods.split(","), entries)))
        out = rows[(rows["method"] == "rigid") & rows["covered"].isna()]
        print(f"\n{block}, {given.subset}: {len(names)} cases, {len(out)} left out without a start")
        print(summary(rows).to_string(index=False, float_format="%.3f"))


if __name__ == "__main__":
    main()
