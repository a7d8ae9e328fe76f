"""Page of the accuracy study: rigid and deformable registration of repeated sweeps, and two settings varied."""

from __future__ import annotations

from pathlib import Path

from experiments import files
from experiments.analysis.pages.page_parts import Shown, listed, read_cases, save_page_figure
from experiments.running.terminal import markdown

HEAD = """# Accuracy of the rigid and the deformable stage

Made by `ctus -m +sweep=figure_accuracy out=FOLDER`{also} and
`python scripts/accuracy.py FOLDER{more}`: {sweeps} sweeps
of each phantom by the built-in simulator, {masks} masks, tissue bent and pressed as the simulator has it by default.
The fixed model is segmented again from a simulated CT.

`rmse_mm` is from the swept points to the model's triangles after the stage; `hd95_mm` counts both ways, and so measures
the part that was not swept where a part was left out. `tre_mm` is the error at the targets: how far the model, as the
stage leaves it, is from where its tissue was swept. `holds` counts the predicted 90 % intervals that hold it, apart for
targets that were swept and others. Sweeps are paired for `p`, an exact signed-rank test on the error.

![Residual and true error](accuracy.png)

"""
SETTINGS = """
## Two settings varied

![Residual and true error by setting](accuracy_settings.png)

"""


def write_page(folder: Path, settings: Path | None, out: Path, shown: Shown, shown_settings: Shown) -> int:
    """Write ``accuracy.md`` and its figures.

    Parameters
    ----------
    folder : Path
        Folder that study=accuracy wrote.
    settings : Path or None
        Folder that it wrote with two settings varied; None leaves that part out.
    out : Path
        Folder of the page.
    shown : callable
        Tables, figures and findings of the cases.
    shown_settings : callable
        The same of the cases with two settings varied.

    Returns
    -------
    int
        Number of rows.

    Raises
    ------
    InputError
        If a folder does not hold the study's results.
    """
    cases = read_cases(folder, "study=accuracy wrote")
    outcome = shown(cases)
    page = HEAD.format(
        sweeps=int(cases.groupby(["phantom", "share", "method"]).size().max()),
        masks=" and ".join(sorted(set(cases["masks"]))),
        also="" if settings is None else ",\n`ctus -m +sweep=accuracy_settings out=SETTINGS`",
        more="" if settings is None else " SETTINGS",
    )
    page += f"{markdown(dict(outcome.tables))}\n{listed(outcome.findings)}\n"
    figures = {"accuracy": outcome.figures["accuracy"]}
    if settings is not None:
        varied = shown_settings(read_cases(settings, "study=accuracy wrote"))
        page += f"{SETTINGS}{markdown(dict(varied.tables))}\n{listed(varied.findings)}\n"
        figures["accuracy_settings"] = varied.figures["accuracy_settings"]
    files.write_text(out / "accuracy.md", page)
    for name, figure in figures.items():
        save_page_figure(figure, out / name)
    return len(cases)
