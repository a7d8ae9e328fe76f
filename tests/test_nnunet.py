"""nnU-Net's own checker on what ``study=export_dataset`` writes; it is installed in a folder of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from experiments.cli import main

pytestmark = pytest.mark.services
# The checker and what its modules import beyond what the project has; torch and the like are the project's own.
PINS = (
    "nnunetv2==2.8.1",
    "acvl-utils==0.2.6",
    "batchgenerators==0.25.5",
    "blosc2==3.3.4",
    "msgpack==1.1.1",
    "ndindex==1.10.0",
    "numexpr==2.11.0",
    "py-cpuinfo==9.0.0",
)
SCRIPT = """
import sys
from nnunetv2.experiment_planning.verify_dataset_integrity import verify_dataset_integrity

if __name__ == "__main__":
    verify_dataset_integrity(sys.argv[1], num_processes=1)
"""
FINE = "If you didn't see any error messages then your dataset is most likely OK!"


@pytest.fixture(scope="module")
def nnunet(repository: Path) -> Path:
    """The folder that nnU-Net is installed in, apart from the project's environment."""
    folder = repository / ".cache" / "nnunet"
    stamp = folder / "pins.txt"
    if not stamp.is_file() or stamp.read_text() != "\n".join(PINS):
        install = ["install", "--quiet", "--no-deps", "--upgrade", "--target", str(folder), *PINS]
        subprocess.run([sys.executable, "-m", "pip", *install], check=True, timeout=600)
        stamp.write_text("\n".join(PINS))
    return folder


def checked(nnunet: Path, dataset: Path, script: Path) -> subprocess.CompletedProcess[str]:
    script.write_text(SCRIPT)
    return subprocess.run(
        [sys.executable, str(script), str(dataset)],
        env=os.environ | {"PYTHONPATH": str(nnunet)},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


def export(out: Path, *words: str) -> Path:
    assert main(["study=export_dataset", "format=nnunet", f"out={out}", *words]) == 0
    (dataset,) = out.glob("Dataset501_*")
    return dataset


SIMULATED = (
    "dataset=phantom",
    "dataset.sweeps=2",
    "dataset.frames_per_sweep=4",
    "dataset.size_px=64",
    "dataset.workers=1",
)


def test_nnunet_accepts_a_simulated_data_set_and_says_so(home: Path, tmp_path: Path, nnunet: Path) -> None:
    dataset = export(tmp_path / "out", *SIMULATED)
    done = checked(nnunet, dataset, tmp_path / "check.py")
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert FINE in done.stdout
    assert "error" not in done.stdout.replace(FINE, "").lower() and "warning" not in done.stdout.lower()


@pytest.mark.parametrize(
    "damage, said",
    [
        (lambda mask: np.where(mask == 1, 2, mask), "Unexpected labels found"),
        (lambda mask: mask[:-1], "Shape mismatch"),
    ],
)
def test_nnunet_refuses_what_was_damaged(home: Path, tmp_path: Path, nnunet: Path, damage, said: str) -> None:
    """Of an export whose masks have another number, or another size, it says so: the checker does look."""
    dataset = export(tmp_path / "out", *SIMULATED)
    for path in (dataset / "labelsTr").iterdir():
        Image.fromarray(damage(np.asarray(Image.open(path))).astype(np.uint8)).save(path)
    done = checked(nnunet, dataset, tmp_path / "check.py")
    assert done.returncode != 0 and said in done.stdout


def test_nnunet_accepts_real_data(home: Path, tmp_path: Path, nnunet: Path, real_data: Path) -> None:
    dataset = export(tmp_path / "out", "dataset=usgra", f"dataset.root={real_data / 'usgra'}")
    done = checked(nnunet, dataset, tmp_path / "check.py")
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert FINE in done.stdout and "warning" not in done.stdout.lower()
