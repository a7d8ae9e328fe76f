"""Comparators of the drift: how BCPD is called, and that a missing or failing one is a sentence."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from registration.benchmark.drift_comparators import drift_by_bcpd, require_package
from registration.deformable.point_drift import PointResiduals
from registration.errors import InputError

SHIFT_MM = np.array([1.0, 0.0, 0.0])
MODEL_MM = np.random.default_rng(0).normal(size=(60, 3)) * [20.0, 5.0, 5.0]
SWEPT_MM = MODEL_MM[:50] + SHIFT_MM
SETTINGS = PointResiduals(beta_mm=10.0, rank=100, max_iterations=50, tolerance=1e-12)
# Reads its options as getopt does, keeps them, and writes the source moved by 1 mm.
COPY = """
import getopt, sys
given = dict(getopt.getopt(sys.argv[1:], "x:y:o:s:u:w:b:l:g:n:N:c:K:J:r:pq")[0])
print(given, file=open("{kept}", "w"))
with open(given["-y"]) as source, open(given["-o"] + "y.txt", "w") as moved:
    for line in source:
        x, y, z = (float(word) for word in line.split(","))
        print(f"{{x + 1:.9f}}\\t{{y:.9f}}\\t{{z:.9f}}", file=moved)
assert len(open(given["-x"]).readlines()) == 50
"""


def program(folder: Path, text: str) -> Path:
    path = folder / "bcpd"
    path.write_text(f"#!{sys.executable}\n{text}")
    path.chmod(0o755)
    return path


def test_bcpd_gets_both_clouds_and_its_moved_source_is_read(tmp_path: Path) -> None:
    made = program(tmp_path, COPY.format(kept=tmp_path / "kept"))
    moved_mm = drift_by_bcpd(made, MODEL_MM, SWEPT_MM, SETTINGS)
    np.testing.assert_allclose(moved_mm, MODEL_MM + SHIFT_MM, atol=1e-6)
    given = eval((tmp_path / "kept").read_text())
    scale_mm = np.sqrt(MODEL_MM.var(axis=0).mean())
    assert float(given["-b"]) == pytest.approx(10.0 / scale_mm, rel=1e-5)
    # Displacements of 2 mm are expected.
    assert np.sqrt(3 / float(given["-l"])) * scale_mm == pytest.approx(2.0, rel=1e-5)
    assert (given["-n"], given["-N"], given["-c"], given["-w"]) == ("50", "50", "1e-12", "0.1")
    assert (given["-K"], given["-J"], given["-u"], given["-s"]) == ("60", "110", "y", "y")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "import sys; print('starts'); print('ERROR: -b wrong', file=sys.stderr); sys.exit(3)",
            "status 3 and 'ERROR: -b wrong'",
        ),
        ("", "expected moved points in out_y.txt, received none"),
        (COPY.format(kept="/dev/null").replace("x + 1", "float('nan')"), "expected 60 finite points"),
        (
            "import sys; open(sys.argv[6] + 'y.txt', 'w').write('1 2 3')",
            r"received an array of shape \(1, 3\)",
        ),
    ],
)
def test_a_program_that_fails_is_a_sentence(text: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=sentence) as refusal:
        drift_by_bcpd(program(tmp_path, text), MODEL_MM, SWEPT_MM, SETTINGS)
    assert "\n" not in str(refusal.value)


def test_what_is_missing_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none: expected the program bcpd, found no file"):
        drift_by_bcpd(tmp_path / "none", MODEL_MM, SWEPT_MM, SETTINGS)
    (tmp_path / "text").write_text("no program")
    with pytest.raises(InputError, match="expected a program that can be run"):
        drift_by_bcpd(tmp_path / "text", MODEL_MM, SWEPT_MM, SETTINGS)
    with pytest.raises(InputError, match=r"pip install no_such_drift"):
        require_package("no_such_drift")
