"""The page of the robustness study, letter by letter from made-up trials and a made-up summary of them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from experiments.analysis.pages import robustness
from experiments.outcome import Outcome

CASES = pd.DataFrame(
    {"method": ["mine", "other", "mine"], "anatomy": ["aorta", "aorta", "vein"], "tre_mm": [0.5, 7.0, 1 / 3]}
)
PAGE = """# Rigid registration from known wrong poses: made

Made by `ctus -m +sweep=<preset> target=<surface> out=FOLDER` (study=robustness) and
`python scripts/robustness_results.py FOLDER made`: 3 trials of mine, other on aorta, vein.

Every method meets the same problems. `tre_mm` is the root mean square error over the whole model's targets,
`success_tre` an error of at most 2 mm, `success` a residual `rmse_mm` of at most 1 mm; `low_rmse_wrong` counts trials
with that residual and more than 2 mm of error. Rates carry Wilson 95 % intervals. Places are ends and middle of the
vessel along its principal axis, rotations of `any` axis, `roll` about the principal one and `flip` across it. The
capture range is the largest angle up to which every bin has at least 95 % success. Times are of one thread.

![errors](made_errors.png)

![runtime](made_runtime.png)

### robustness

| method | tre_mm |
| --- | --- |
| mine | 0.500 |
| other | 7.000 |
| mine | 0.333 |

- Mine is better.
- Other is faster.
"""


def shown(cases: pd.DataFrame) -> Outcome:
    return Outcome(
        tables={"robustness": cases[["method", "tre_mm"]]},
        figures={"errors": Figure(), "runtime": Figure()},
        findings=("Mine is better.", "Other is faster."),
    )


def test_page_tables_and_figures(tmp_path: Path) -> None:
    CASES.to_parquet(tmp_path / "cases.parquet")
    out = tmp_path / "results"
    assert robustness.write_page(tmp_path, out, "made", shown) == 3
    assert (out / "made.md").read_text(encoding="utf-8") == PAGE
    table = "method,tre_mm\nmine,0.5\nother,7\nmine,0.333333\n"
    assert (out / "made_robustness.csv").read_text(encoding="utf-8") == table
    names = {"made.md", "made_robustness.csv", "made_errors.png", "made_runtime.png"}
    assert {path.name for path in out.iterdir()} == names
