"""Page of the known deformations: what was registered, tables, and what was asked for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from experiments import files
from experiments.analysis.pages.page_parts import listed
from experiments.analysis.registration.benchmark.known import describe_known, known_tables
from experiments.running.terminal import markdown

if TYPE_CHECKING:
    import pandas as pd

HEAD = """# Known smooth deformations

Made by `{command}`{commit}. 3000 points are drawn on the displaced wall, with 0.3 mm of noise per coordinate, and 5000
apart from them on the undisplaced one, without; the ends of the vessel, which no sweep sees, are left out of the
former. Swept are 60, 80 or 100 % of the wall, a stretch along the vessel. The deformations are functions of place, 1.5,
3 and 5 mm in size, which go round over vessels, deformations and coverages:

- bending: one period of a cosine across the vessel;
- dilation: a local widening, by at most 40 % of the radius;
- indentation: a push from the side that fades within 24 mm;
- none: nothing moves, to see what a deformable method loses.

Vessels: {vessels}. The rigid pose is the multi-start's from a random pose, turned by up to 180 degrees; then the model
is displaced. All settings are the defaults, which were chosen on other anatomies.

Errors are of interior material points: on the centerline at even arc length, and half way from there to the wall. A
case's error is the root mean square over its targets that were swept (covered) or not; tables have means over the
anatomies' means, and ratios of these with 95 % intervals by the bootstrap over anatomies. `no_start` counts cases whose
rigid pose is off the true one by 5 mm more than the wall is displaced at most; they are in no other column. `hold`
counts the predicted 90 % intervals that hold a case's error (Wilson 95 %), `targets_hold` is the mean share of single
targets within their own; targets of a case go together, so that these have no interval of their own. Seconds are
medians on a machine that was not idle.

"""


def write_page(cases: pd.DataFrame, command: str, commit: str, out: Path) -> None:
    """Write ``known_deformations.md`` and ``.csv`` with every case.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows that ``known_rows`` gives.
    command : str
        Command that made them.
    commit : str
        Commit of the code that ran; empty if it is not known.
    out : Path
        Folder of the page.
    """
    text = HEAD.format(
        command=command,
        commit=commit and f", commit {commit}",
        vessels=", ".join(cases["anatomy"].drop_duplicates().tolist()),
    )
    text += listed(describe_known(cases)) + "\n\n" + markdown(known_tables(cases)).strip() + "\n"
    files.write_text(out / "known_deformations.md", text)
    files.write_text(out / "known_deformations.csv", cases.to_csv(index=False, float_format="%.5g"))
