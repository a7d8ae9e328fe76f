"""What a job costs: measured, never invented, and added up on the runs above."""

from __future__ import annotations

import mmap
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest

from experiments.cli import main
from experiments.running import cost
from experiments.running.cost import Cost, Meter, metered, of_tags, total
from experiments.tracking import Store


def test_cores_are_those_of_the_process_and_of_its_children() -> None:
    with metered(alone=True) as meter:
        begun = time.process_time()
        while time.process_time() - begun < 0.3:
            pass
        own = meter.cost()
        spin = "import time\nwhile time.process_time() < 0.4: pass"
        subprocess.run([sys.executable, "-c", spin], check=True)
        both = meter.cost()
    assert 0.25 < own.core_seconds < 1.0
    assert both.core_seconds >= own.core_seconds + 0.35
    assert both.seconds > own.seconds >= 0.25


def test_the_highest_memory_is_that_of_the_block_though_it_was_given_back() -> None:
    with metered(alone=True) as meter:
        before = meter.cost().peak_memory_mb
        # Of the system itself: what other tests have freed may lie ready in the process, and count already.
        with mmap.mmap(-1, 150 * 2**20) as block:
            block.write(bytes(2**20) * 150)
        assert meter.cost().peak_memory_mb > before + 100
    with metered(alone=True) as after:  # another job of the same process has its own
        assert after.cost().peak_memory_mb < before + 100


def test_energy_is_read_where_the_machine_tells_it_and_absent_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cost, "POWERCAP", tmp_path)
    monkeypatch.setattr(cost, "_nvml", lambda: None)
    assert Meter().cost().cpu_energy_j is None
    for name, value in {"intel-rapl:0": 5_000_000, "intel-rapl:1": 1_000_000, "intel-rapl:0:0": 9}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "energy_uj").write_text(str(value))
    meter, second = Meter(), Meter(alone=False)
    (tmp_path / "intel-rapl:0" / "energy_uj").write_text("7500000")
    assert meter.cost().cpu_energy_j == 2.5
    assert meter.cost().gpu_energy_j is None
    assert second.cost().cpu_energy_j is None
    (tmp_path / "intel-rapl:0" / "energy_uj").write_text("10")  # the counter has begun anew
    assert meter.cost().cpu_energy_j is None
    assert "ctus.cost.cpu_energy_j" not in meter.cost().tags()


def test_costs_add_up_only_where_all_are_known() -> None:
    first, second = Cost(1.0, 2.0, 100.0, 5.0), Cost(3.0, 4.0, 50.0)
    assert total([first, second]) == Cost(4.0, 6.0, 100.0)
    assert total([first, first]) == Cost(2.0, 4.0, 100.0, 10.0)
    assert total([first, None]) is None
    assert total([]) is None
    assert of_tags(first.tags()) == first
    assert of_tags({"level": "result"}) is None


def test_every_run_has_its_cost_and_the_sweep_their_sum_also_when_resumed(
    counting_study: ModuleType, home: Path
) -> None:
    out = f"out={home / 'result'}"
    assert main(["study=counting", "parts=[1,2]", "fail_on=[2]", out]) == 1
    failed = [run for run in Store().runs(["counting"]) if run.data.tags["ctus.kind"] == "job"]
    assert all(of_tags(run.data.tags) is not None for run in failed)
    assert main(["study=counting", "parts=[1,2,3]", out]) == 0
    assert main(["study=counting", "parts=[1,2,3]", out, "resume=true"]) == 0
    runs = list(Store().runs(["counting"], "attributes.status = 'FINISHED'"))
    sweep = next(run for run in runs if run.data.tags["ctus.kind"] == "sweep")
    jobs = [run for run in runs if run.data.tags.get("mlflow.parentRunId") == sweep.info.run_id]
    together, parts = of_tags(sweep.data.tags), [of_tags(run.data.tags) for run in jobs]
    assert len(parts) == 3
    assert together is not None
    assert together.core_seconds == pytest.approx(sum(each.core_seconds for each in parts if each), rel=0.2)
    assert together.peak_memory_mb == pytest.approx(
        max(each.peak_memory_mb for each in parts if each), rel=0.01
    )
    assert not any("cost" in name for run in runs for name in run.data.metrics)
