"""Page of the consistency study: repeated reconstructions of one phantom."""

from __future__ import annotations

from pathlib import Path

from experiments import files
from experiments.analysis.pages.page_parts import Shown, listed, read_cases, save_page_figure
from experiments.running.terminal import markdown

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


def write_page(folder: Path, out: Path, shown: Shown, truth: str) -> int:
    """Write ``consistency.md`` and ``consistency.png``.

    Parameters
    ----------
    folder : Path
        Folder that study=consistency wrote.
    out : Path
        Folder of the page.
    shown : callable
        Tables, figures and findings of the cases.
    truth : str
        Kind of the rows that compare one sweep with the truth.

    Returns
    -------
    int
        Number of sweeps.

    Raises
    ------
    InputError
        If the folder does not hold the study's results.
    """
    cases = read_cases(folder, "study=consistency wrote")
    truths = cases[cases["kind"] == truth]
    head = HEAD.format(
        sweeps=truths.groupby("phantom").size().max(),
        frames=int(truths["frames"].max()),
        masks=" and ".join(sorted(set(truths["masks"]))),
    )
    outcome = shown(cases)
    page = f"{head}{markdown(dict(outcome.tables))}\n{listed(outcome.findings)}\n"
    files.write_text(out / "consistency.md", page)
    save_page_figure(outcome.figures["consistency"], out / "consistency")
    return len(truths)
