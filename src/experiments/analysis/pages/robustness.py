"""Page of the robustness study: rigid registration from known wrong poses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from experiments import files
from experiments.analysis.pages.page_parts import Shown, listed, read_cases, save_page_figure
from experiments.running.terminal import markdown

if TYPE_CHECKING:
    import pandas as pd

HEAD = """# Rigid registration from known wrong poses: {name}

Made by `ctus -m +sweep=<preset> target=<surface> out=FOLDER` (study=robustness) and
`python scripts/robustness_results.py FOLDER {name}`: {trials} trials of {methods} on {anatomies}.

Every method meets the same problems. `tre_mm` is the root mean square error over the whole model's targets,
`success_tre` an error of at most 2 mm, `success` a residual `rmse_mm` of at most 1 mm; `low_rmse_wrong` counts trials
with that residual and more than 2 mm of error. Rates carry Wilson 95 % intervals. Places are ends and middle of the
vessel along its principal axis, rotations of `any` axis, `roll` about the principal one and `flip` across it. The
capture range is the largest angle up to which every bin has at least 95 % success. Times are of one thread.

"""


def write_page(folder: Path, out: Path, name: str, shown: Shown) -> int:
    """Write ``<name>.md`` with its tables (CSV) and figures (PNG).

    Parameters
    ----------
    folder : Path
        Folder that study=robustness wrote.
    out : Path
        Folder of the page.
    name : str
        Name of the page, and what the names of its tables and figures begin with.
    shown : callable
        Tables, figures and findings of the cases.

    Returns
    -------
    int
        Number of trials.

    Raises
    ------
    InputError
        If the folder does not hold the study's results.
    """
    cases = read_cases(folder, "study=robustness wrote")
    outcome = shown(cases)
    figures = "\n\n".join(f"![{title}]({name}_{title}.png)" for title in outcome.figures)
    page = f"{_head(cases, name)}{figures}\n\n{markdown(dict(outcome.tables))}\n{listed(outcome.findings)}\n"
    files.write_text(out / f"{name}.md", page)
    for title, table in outcome.tables.items():
        files.write_text(out / f"{name}_{title}.csv", table.to_csv(index=False, float_format="%.6g"))
    for title, figure in outcome.figures.items():
        save_page_figure(figure, out / f"{name}_{title}")
    return len(cases)


def _head(cases: pd.DataFrame, name: str) -> str:
    return HEAD.format(
        name=name,
        trials=len(cases),
        methods=", ".join(cases["method"].drop_duplicates()),
        anatomies=", ".join(cases["anatomy"].drop_duplicates()),
    )
