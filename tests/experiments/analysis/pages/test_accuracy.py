"""The page of the accuracy study from made-up rows: what it says of them, and the part that may be left out."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure

from experiments.analysis.pages import accuracy
from experiments.errors import InputError
from experiments.outcome import Outcome

CASES = pd.DataFrame(
    {"phantom": ["vein"] * 3 + ["artery"], "share": 1.0, "method": "cpd", "masks": ["exact"] * 4}
)


def shown(cases: pd.DataFrame) -> Outcome:
    tables = {"residuals": cases.loc[:0, ["phantom", "method"]]}
    return Outcome(tables=tables, figures={"accuracy": Figure()}, findings=("It is better.",))


def varied(cases: pd.DataFrame) -> Outcome:
    return Outcome(figures={"accuracy_settings": Figure()}, findings=("They differ.",))


def test_page_and_figures(tmp_path: Path) -> None:
    CASES.to_parquet(tmp_path / "cases.parquet")
    out = tmp_path / "results"
    assert accuracy.write_page(tmp_path, None, out, shown, varied) == 4
    page = (out / "accuracy.md").read_text(encoding="utf-8")
    assert "and\n`python scripts/accuracy.py FOLDER`: 3 sweeps\nof each phantom" in page
    assert page.endswith("| vein | cpd |\n\n- It is better.\n")
    assert {path.name for path in out.iterdir()} == {"accuracy.md", "accuracy.png"}

    assert accuracy.write_page(tmp_path, tmp_path, out, shown, varied) == 4
    page = (out / "accuracy.md").read_text(encoding="utf-8")
    assert (
        "`ctus -m +sweep=accuracy_settings out=SETTINGS` and\n`python scripts/accuracy.py FOLDER SETTINGS`"
        in page
    )
    assert page.endswith("- They differ.\n")
    assert (out / "accuracy_settings.png").is_file()


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected the folder that study=accuracy wrote"):
        accuracy.write_page(tmp_path, None, tmp_path, shown, varied)
