"""Error of interior points under known smooth deformations, after the rigid pose and after the model was displaced.

    python scripts/bench_known_deformations.py [FOLDER] [--results results] [--quick]

Bending, dilation, indentation and none, of 1.5 to 5 mm, on a real aorta, the simulator's artery and vein, and 12 random
test anatomies; 60 to 100 % of the wall is swept, with 0.3 mm of noise. FOLDER holds the aorta; without it the other
vessels are tried. --results writes known_deformations.md and .csv, the page in results/. A case takes some seconds.
"""

from __future__ import annotations

import os

# Read by the numerical libraries when they are imported: one core.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import argparse
import sys
from pathlib import Path

import pandas as pd
from quick_budget import data_folder, parsed

from experiments.analysis.pages.known_deformations import write_page
from experiments.analysis.registration.benchmark.known import describe_known, known_rows, known_tables
from experiments.provenance import running_commit
from experiments.running.terminal import TerminalProgress
from registration.benchmark.known_cases import COVERAGES, known_specs
from registration.benchmark.known_deformations import DEFORMATIONS
from registration.benchmark.known_vessels import AORTA, DESIGNED, RANDOM_SEEDS

VESSELS = (AORTA, *DESIGNED, *(f"random{seed}" for seed in RANDOM_SEEDS))


def main() -> None:
    """Register every case, print tables, and write the page if it is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--vessels", default=",".join(VESSELS), help="aorta, artery, vein, random<seed>")
    parser.add_argument("--deformations", default=",".join(DEFORMATIONS), help="of these")
    parser.add_argument("--coverages", default=",".join(map(str, COVERAGES)), help="shares that are swept")
    parser.add_argument("--results", type=Path, help="folder of the page")
    given = parsed(parser, {"vessels": "artery", "deformations": "bending", "coverages": "0.8"})
    commit = running_commit()
    vessels = given.vessels.split(",")
    aorta = data_folder(given.folder, "vmtk") if AORTA in vessels else None
    if aorta is None:
        vessels = [name for name in vessels if name != AORTA]
    coverages = [float(share) for share in given.coverages.split(",")]
    specs = list(known_specs(vessels, given.deformations.split(","), coverages))
    rows = TerminalProgress().track(known_rows(specs, aorta), "registering cases", len(specs))
    cases = pd.DataFrame(list(rows))
    for title, table in known_tables(cases).items():
        print(f"\n{title}\n{table.to_string(index=False, float_format='%.3f')}")
    print("", *describe_known(cases), sep="\n")
    if given.results:
        command = " ".join(["python scripts/bench_known_deformations.py", *sys.argv[1:]])
        write_page(cases, command, commit, given.results)


if __name__ == "__main__":
    main()
