"""What needs programs of the system: ``make test-services`` installs and uses them."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pandas as pd
import pytest

from experiments.studies.report.latex import latex_document, latex_table

pytestmark = pytest.mark.services
HOSTILE = ["50 % of tre_mm & more", r"\input{x} $y^2$ #1 ~", "±°µ×≤≥− < > | {a}", "Grün, 血管", ""]


def test_every_table_compiles_whatever_its_names_are(tmp_path: Path) -> None:
    assert shutil.which("pdflatex"), "make test-services installs texlive-latex-base and -recommended"
    wide = pd.DataFrame({f"column_{number} %": HOSTILE for number in range(14)})
    tables = {
        "wide": wide,
        "narrow": wide.iloc[:, :1],
        "empty": wide.iloc[:0],
        "numbers": pd.DataFrame({"n": [1.5]}),
    }
    for name, table in tables.items():
        (tmp_path / f"{name}.tex").write_text(latex_table(table, HOSTILE[1], name), encoding="utf-8")
    document = latex_document(dict.fromkeys(tables, HOSTILE[0]))
    (tmp_path / "report.tex").write_text(document, encoding="utf-8")
    done = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape", "report.tex"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:]
    assert (tmp_path / "report.pdf").stat().st_size > 1000
    assert "Overfull" not in done.stdout
