"""Page of the frozen benchmark of rigid registration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from experiments import files
from experiments.analysis.pages.page_parts import listed, read_cases, save_page_figure
from experiments.analysis.registration.benchmark.figures import benchmark_figures
from experiments.analysis.registration.benchmark.findings import describe_benchmark
from experiments.analysis.registration.benchmark.tables import benchmark_tables
from experiments.running.terminal import markdown

if TYPE_CHECKING:
    import pandas as pd

WRITER = "make rigid-benchmark writes"
# Columns in which an empty field is a text, and no missing number.
TEXTS = ("error", "place", "kind", "block")
BLOCKS_FIGURE = "![Risk, predicted error, blocks](rigid_benchmark_blocks.png)"
HEAD = """# Rigid registration on the frozen benchmark

Made by `make rigid-benchmark`. A case is a simulated sweep of a random anatomy, reconstructed from its exact masks with
the simulator's default pose noise, and the model that was re-segmented from a simulated CT of the same anatomy; tissue
does not deform. 3000 moving points start turned by up to 180 degrees and moved by up to 50 mm, 5000 points of the model
stay. Of each anatomy there is the whole sweep, pieces of 80, 60 and 40 % of its frames, one with 10 % outliers and
one with 30 % of its frames missing.

`tre_mm` is the root mean square over the model's centerline, swept or not; success is a TRE of at most 2 mm. Intervals
(`low`, `high`) of methods are by the bootstrap over anatomies, all others Wilson's, at 95 %. A result is
rightly not accepted if another pose, elsewhere by more than 2 mm, explains the clouds within their noise: it is looked
for from the true pose, by slides, rolls and half turns, and from the method's own candidates. `runtime_s` is of worker
processes that share the machine with whatever else runs; `scripts/bench_rigid.py` compares times.

![Risk, predicted error, kinds](rigid_benchmark.png)
"""
BLOCKS = """What else there is in a clinic, on anatomies that no other section shows (seeds 1100 to 1123):

- deforming: the probe presses, the body bends, something indents the tissue beside the vessel, or a rough random field
  (Matern 3/2) moves it, by 1.5, 2 and 4 mm, on random anatomies, an artery and a vein, swept whole or by 70 %. The true
  pose (`tre_rigid_mm` is the error against it) brings the wall of the whole model nearest to where it was swept.
  `tre_mm` is where the material of a target really was against where the result puts it: no rigid pose is expected
  below `lowest_tre_mm`, which the true one has.
- wrong vessel: the sweep of one anatomy with the model of another or with the mirror image of its own, whole or a 40 %
  piece; any accepted result is wrong. 40 % pieces of the right vessel are the control (`right_accepted_rate`).
- overlap: sweep and model each show about two thirds of the vessel, 40, 50 or 60 % of either in common, segmented in
  other styles, with a coarse centerline; in a third of the cases the pose is known within 12 degrees and 6 mm.
- noise: 1 mm per coordinate on the sweep's points, or on those of both sides.

`accepted_wrong_rate` is the share of all cases of a block that were accepted with a TRE above 2 mm,
`high_over_error_median` the upper end of the predicted interval over the error, `risk_area` the area under risk against
coverage. Bounds are Wilson's at 95 %.
"""
BASELINE_NOTE = (
    "`{method}` is an earlier version of the method, whose intervals and verdicts are by a bootstrap that takes "
    "stretches of 1.25 mm for independent; its rows are kept in `{file}`."
)
BASELINE_FILE = "rigid_benchmark_baseline.csv"
SECTIONS = {
    "test": "Test anatomies (seeds 1000 to 1023)",
    "symmetric": "Symmetric shapes, which have more than one right pose",
    "blocks": "Deforming tissue, other vessels, partial overlap and noise",
}


def write_page(folder: Path, out: Path) -> int:
    """Write ``rigid_benchmark.md``, ``.csv`` with every case, and ``.png``.

    Parameters
    ----------
    folder : Path
        Folder that holds a folder ``test``, and may hold ``symmetric`` and ``blocks``, each as study=rigid_benchmark
        wrote it.
    out : Path
        Folder of the page. Results of a baseline that are kept there are set beside those of the blocks.

    Returns
    -------
    int
        Number of results of methods.

    Raises
    ------
    InputError
        If there are no results of the test cases.
    """
    import pandas as pd

    cases = {"test": read_cases(folder, WRITER, "test")}
    for name in ("symmetric", "blocks"):
        if (folder / name / "cases.parquet").is_file():
            cases[name] = read_cases(folder, WRITER, name)
    page, figures = HEAD, {"rigid_benchmark": benchmark_figures(cases["test"])}
    for name, rows in cases.items():
        page += f"\n## {SECTIONS[name]}\n\n"
        if name != "blocks":
            page += f"{listed(describe_benchmark(rows))}\n\n{markdown(benchmark_tables(rows))}"
            continue
        shown, note = _beside_baseline(rows, out)
        figures["rigid_benchmark_blocks"] = benchmark_figures(shown)
        page += f"{BLOCKS}{note}\n{BLOCKS_FIGURE}\n\n{listed(describe_benchmark(shown))}\n\n{_tables(shown)}"
    files.write_text(out / "rigid_benchmark.md", page.rstrip() + "\n")
    everything = pd.concat(cases.values(), ignore_index=True)
    files.write_text(out / "rigid_benchmark.csv", everything.to_csv(index=False, float_format="%.4f"))
    for name, made in figures.items():
        save_page_figure(made["rigid_benchmark"], out / name)
    return len(everything)


def _tables(rows: pd.DataFrame) -> str:
    """The tables of all blocks without that of every case not accepted, which the CSV file has."""
    tables = benchmark_tables(rows)
    return markdown({name: table for name, table in tables.items() if not name.startswith("not accepted")})


def _beside_baseline(rows: pd.DataFrame, out: Path) -> tuple[pd.DataFrame, str]:
    """The rows with those of the kept baseline, and what is to be said of it."""
    import pandas as pd

    path = out / BASELINE_FILE
    if not path.is_file():
        return rows, ""
    kept = pd.read_csv(
        path, keep_default_na=False, na_values={str(name): [""] for name in rows if name not in TEXTS}
    )
    both = pd.concat([rows, kept[[name for name in rows if name in kept]]], ignore_index=True)
    method = ", ".join(kept["method"].drop_duplicates())
    return both, "\n" + BASELINE_NOTE.format(method=method, file=BASELINE_FILE) + "\n"
