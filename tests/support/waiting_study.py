"""A study that other processes find too, as a plugin on their path: each job says where it is and may wait."""

from __future__ import annotations

from pathlib import Path

STUDY = '''
"""Count, and wait where a file says so."""
import os
import time
from pathlib import Path

import pandas as pd
from experiments.outcome import JobResult, Outcome

def jobs(config):
    return [{"part": part} for part in config["parts"]]

def run(*, part: int, notes: str) -> Outcome:
    place = Path(notes)
    gpu = os.environ.get("CUDA_VISIBLE_DEVICES", "none")
    with (place / f"{part}.started").open("a") as started:
        started.write(f"{os.getpid()} {os.environ['OMP_NUM_THREADS']} {gpu}\\n")
    while (place / f"{part}.wait").exists():
        time.sleep(0.05)
    return Outcome(metrics={"value": float(part)}, cases=pd.DataFrame({"case_id": [part], "value": [float(part)]}))

def summarise(results: list[JobResult]) -> Outcome:
    return Outcome(metrics={"parts": len(results)}, findings=(f"{len(results)} parts",))
'''
FILES = {
    "__init__.py": '"""A plugin."""\n',
    "studies/__init__.py": "",
    "studies/waiting.py": STUDY,
    "conf/study/waiting.yaml": "# @package _global_\n# Wait.\nparts: [0, 1]\npart: null\nnotes: ???\n",
}
RECORD = {
    "METADATA": "Metadata-Version: 2.1\nName: toy_waiting\nVersion: 1.0\n",
    "entry_points.txt": "[ctus.plugins]\ntoy_waiting = toy_waiting\n",
}


def install(site: Path) -> None:
    """Write the plugin into a folder that PYTHONPATH is to name."""
    for name, text in FILES.items():
        path = site / "toy_waiting" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    for name, text in RECORD.items():
        path = site / "toy_waiting-1.0.dist-info" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
