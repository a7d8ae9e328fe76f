"""Write results/consistency.md and results/consistency.png from what study=consistency measured.

Usage: python scripts/consistency.py FOLDER [RESULTS], where FOLDER is what `ctus study=consistency out=FOLDER` left.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from experiments import files
from experiments.reporting.figure_files import save_figure
from experiments.running.terminal import markdown
from experiments.studies.consistency.report import TRUTH, describe, figures, tables

HEAD = """# Repeated reconstructions of one phantom

Made by `ctus study=consistency out=FOLDER` and `python scripts/consistency.py FOLDER`: {sweeps} sweeps of each phantom
by the built-in simulator, {frames} frames each, pose noise as the simulator has it by default, {masks} masks.

Between sweeps: all pairs of sweeps of one phantom, as tracked, without any registration. `msd_mm` is the mean distance
from point to triangle, both ways, `hd95_mm` the larger of both directions' 95th percentiles (interval: bootstrap over
sweeps). `hd95_covered_mm` leaves out places past the ends of the other surface, `hd95_tissue_mm` takes out the
deformation by the probe's pressure, which differs from sweep to sweep and is known exactly.

To the truth: each sweep against the undeformed anatomy, the known deformation taken out. `bias_mm` is positive where
the surface lies too far out. `common_mm` is the mean absolute error that all sweeps share at a place of the vessel:
repeats agree on it, so no comparison between them can show it. `covered` is the share of the anatomy that was swept.

![Between sweeps and to the truth](consistency.png)

"""


def main() -> int:
    """Write the page and its figure; 2 if the folder does not hold the study's results."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    out = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("results")
    if len(sys.argv) < 2 or not (folder / "cases.parquet").is_file():
        print(f"{folder}: expected the folder that study=consistency wrote, found none", file=sys.stderr)
        return 2
    cases = pd.read_parquet(folder / "cases.parquet")
    truths = cases[cases["kind"] == TRUTH]
    head = HEAD.format(
        sweeps=truths.groupby("phantom").size().max(),
        frames=int(truths["frames"].max()),
        masks=" and ".join(sorted(set(truths["masks"]))),
    )
    said = "\n".join(f"- {sentence}" for sentence in describe(cases))
    files.write_text(out / "consistency.md", head + markdown(tables(cases)) + "\n" + said + "\n")
    save_figure(figures(cases)["consistency"], out / "consistency", ("png",), dpi=110)
    print(f"{len(truths)} sweeps: {out / 'consistency.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
