"""Write results/rigid_benchmark.md, .csv and .png from what study=rigid_benchmark measured.

Usage: python scripts/rigid_benchmark.py FOLDER [RESULTS], where FOLDER holds a folder `test`, and may hold one
`symmetric`, as `ctus study=rigid_benchmark subset=test out=FOLDER/test` left them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from experiments import files
from experiments.analysis.registration.benchmark.figures import benchmark_figures
from experiments.analysis.registration.benchmark.findings import describe_benchmark
from experiments.analysis.registration.benchmark.tables import benchmark_tables
from experiments.reporting.figure_files import save_figure
from experiments.running.terminal import markdown

HEAD = """# Rigid registration on the frozen benchmark

Made by `make rigid-benchmark`. A case is a simulated sweep of a random anatomy, reconstructed from its exact masks with
the simulator's default pose noise, and the model that was re-segmented from a simulated CT of the same anatomy; tissue
does not deform. 3000 moving points start turned by up to 180 degrees and moved by up to 50 mm, 5000 points of the model
stay. Of each anatomy there is the whole sweep, pieces of 80, 60 and 40 % of its frames, one with 10 % stray points and
one with 30 % of its frames missing.

`tre_mm` is the root mean square over the model's centerline, swept or not; success is a TRE of at most 2 mm. Intervals
(`low`, `high`) of methods are by the bootstrap over anatomies, all others Wilson's, at 95 %. An answer is doubted
rightly if another pose, elsewhere by more than 2 mm, explains the clouds within their noise: it is looked for from the
true pose, by slides, rolls and half turns, and from the method's own candidates.

![Risk, predicted error, kinds](rigid_benchmark.png)
"""
SECTIONS = {
    "test": "Test anatomies (seeds 1000 to 1023)",
    "symmetric": "Symmetric shapes, which have more than one right pose",
}


def main() -> int:
    """Write page, table and figure; 2 if the folder does not hold the study's results."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    out = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("results")
    found = {name: folder / name / "cases.parquet" for name in SECTIONS}
    if len(sys.argv) < 2 or not found["test"].is_file():
        print(f"{folder}: expected the folder that make rigid-benchmark writes, found none", file=sys.stderr)
        return 2
    cases = {name: pd.read_parquet(path) for name, path in found.items() if path.is_file()}
    page = HEAD
    for name, rows in cases.items():
        said = "\n".join(f"- {sentence}" for sentence in describe_benchmark(rows))
        page += f"\n## {SECTIONS[name]}\n\n{said}\n\n{markdown(benchmark_tables(rows))}"
    files.write_text(out / "rigid_benchmark.md", page.rstrip() + "\n")
    everything = pd.concat(cases.values(), ignore_index=True)
    files.write_text(out / "rigid_benchmark.csv", everything.to_csv(index=False, float_format="%.4f"))
    figure = benchmark_figures(cases["test"])["rigid_benchmark"]
    save_figure(figure, out / "rigid_benchmark", ("png",), dpi=110)
    print(f"{len(everything)} answers: {out / 'rigid_benchmark.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
