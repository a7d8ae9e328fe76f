"""The page of the consistency study, letter by letter from made-up rows and a made-up summary of them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from experiments.analysis.pages import consistency
from experiments.outcome import Outcome

CASES = pd.DataFrame(
    {
        "phantom": ["vein", "vein", "vein", "artery"],
        "kind": ["pair", "truth", "truth", "truth"],
        "frames": [float("nan"), 100.0, 90.0, 80.0],
        "masks": ["exact"] * 4,
    }
)
HEAD = """# Repeated reconstructions of one phantom

Made by `ctus study=consistency out=FOLDER` and `python scripts/consistency.py FOLDER`: 2 sweeps of each phantom
by the built-in simulator, 100 frames each, pose noise as the simulator has it by default, exact masks.

"""
END = """
![Between sweeps and to the truth](consistency.png)

### between sweeps

| phantom | kind |
| --- | --- |
| vein | pair |

- They agree.
"""


def shown(cases: pd.DataFrame) -> Outcome:
    return Outcome(
        tables={"between sweeps": cases.loc[:0, ["phantom", "kind"]]},
        figures={"consistency": Figure()},
        findings=("They agree.",),
    )


def test_page_and_figure(tmp_path: Path) -> None:
    CASES.to_parquet(tmp_path / "cases.parquet")
    out = tmp_path / "results"
    assert consistency.write_page(tmp_path, out, shown, "truth") == 3
    page = (out / "consistency.md").read_text(encoding="utf-8")
    assert page.startswith(HEAD)
    assert page.endswith(END)
    # What the columns mean stands between the two.
    assert page[len(HEAD) : -len(END)].count("\n") == 8
    assert {path.name for path in out.iterdir()} == {"consistency.md", "consistency.png"}
