"""Page of the frozen benchmark of rigid registration."""

from __future__ import annotations

from pathlib import Path

from experiments import files
from experiments.analysis.pages.page_parts import listed, read_cases, save_page_figure
from experiments.analysis.registration.benchmark.figures import benchmark_figures
from experiments.analysis.registration.benchmark.findings import describe_benchmark
from experiments.analysis.registration.benchmark.tables import benchmark_tables
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


def write_page(folder: Path, out: Path) -> int:
    """Write ``rigid_benchmark.md``, ``.csv`` with every case, and ``.png``.

    Parameters
    ----------
    folder : Path
        Folder that holds a folder ``test``, and may hold one ``symmetric``, each as study=rigid_benchmark wrote it.
    out : Path
        Folder of the page.

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

    cases = {"test": read_cases(folder, "make rigid-benchmark writes", "test")}
    if (folder / "symmetric" / "cases.parquet").is_file():
        cases["symmetric"] = read_cases(folder, "make rigid-benchmark writes", "symmetric")
    page = HEAD
    for name, rows in cases.items():
        findings = listed(describe_benchmark(rows))
        page += f"\n## {SECTIONS[name]}\n\n{findings}\n\n{markdown(benchmark_tables(rows))}"
    files.write_text(out / "rigid_benchmark.md", page.rstrip() + "\n")
    everything = pd.concat(cases.values(), ignore_index=True)
    files.write_text(out / "rigid_benchmark.csv", everything.to_csv(index=False, float_format="%.4f"))
    save_page_figure(benchmark_figures(cases["test"])["rigid_benchmark"], out / "rigid_benchmark")
    return len(everything)
