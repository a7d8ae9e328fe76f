"""Write results/<NAME>.md with its tables (CSV) and figures (PNG) from what study=robustness measured.

Usage: python scripts/robustness_results.py FOLDER [NAME] [RESULTS], where FOLDER is what
`ctus -m +sweep=<preset> target=<surface> out=FOLDER` left; NAME is robustness, RESULTS is results by default.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from experiments import files
from experiments.outcome import Outcome
from experiments.reporting.figure_files import save_figure
from experiments.running.terminal import markdown
from experiments.studies.robustness import study as robustness

HEAD = """# Rigid registration from known wrong poses: {name}

Made by `ctus -m +sweep=<preset> target=<surface> out=FOLDER` (study=robustness) and
`python scripts/robustness_results.py FOLDER {name}`: {trials} trials of {methods} on {anatomies}.

Every method meets the same problems. `tre_mm` is the root mean square error over the whole model's targets,
`success_tre` an error of at most 2 mm, `success` a residual `rmse_mm` of at most 1 mm; `low_rmse_wrong` counts trials
with that residual and more than 2 mm of error. Rates carry Wilson 95 % intervals. Places are ends and middle of the
vessel along its principal axis, rotations of `any` axis, `roll` about the principal one and `flip` across it. The
capture range is the largest angle up to which every bin has at least 95 % success. Times are of one thread.

"""


def main() -> int:
    """Write the page, its tables and its figures; 2 if the folder does not hold the study's results."""
    given = sys.argv[1:]
    folder = Path(given[0]) if given else Path()
    name, out = (*given[1:3], *["robustness", "results"][len(given[1:3]) :])
    if not given or not (folder / "cases.parquet").is_file():
        print(f"{folder}: expected the folder that study=robustness wrote, found none", file=sys.stderr)
        return 2
    cases = pd.read_parquet(folder / "cases.parquet")
    outcome = robustness.shown(cases)
    _write(outcome, Path(out), name, _head(cases, name))
    print(f"{len(cases)} trials: {Path(out) / name}.md")
    return 0


def _head(cases: pd.DataFrame, name: str) -> str:
    return HEAD.format(
        name=name,
        trials=len(cases),
        methods=", ".join(cases["method"].drop_duplicates()),
        anatomies=", ".join(cases["anatomy"].drop_duplicates()),
    )


def _write(outcome: Outcome, out: Path, name: str, head: str) -> None:
    shown = "\n\n".join(f"![{figure}]({name}_{figure}.png)" for figure in outcome.figures)
    said = "\n".join(f"- {sentence}" for sentence in outcome.findings)
    page = f"{head}{shown}\n\n{markdown(dict(outcome.tables))}\n{said}\n"
    files.write_text(out / f"{name}.md", page)
    for title, table in outcome.tables.items():
        files.write_text(out / f"{name}_{title}.csv", table.to_csv(index=False, float_format="%.6g"))
    for title, figure in outcome.figures.items():
        save_figure(figure, out / f"{name}_{title}", ("png",), dpi=110)


if __name__ == "__main__":
    sys.exit(main())
