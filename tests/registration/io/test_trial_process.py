"""Transforms are read in another process first: whole ones pass, what fails or does not end is refused."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.io import trial_process
from registration.io.transforms import write_transform


def test_a_whole_transform_passes_and_another_file_under_its_name_is_tried_again(tmp_path: Path) -> None:
    path = tmp_path / "t.h5"
    write_transform(path, np.eye(4))
    trial_process.require_harmless_transform(path)
    path.write_bytes(path.read_bytes()[:200] + bytes(100))
    with pytest.raises(InputError, match=r"t\.h5: expected a complete ITK transform, received a file that"):
        trial_process.require_harmless_transform(path)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("while True: pass", "keeps its reader busy"),
        ("os.abort()", "that crashes"),
        ("1 / 0", "cannot be read as one"),
    ],
)
def test_readers_that_do_not_end_crash_or_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, message: str
) -> None:
    monkeypatch.setattr(trial_process, "_LOAD", "")
    monkeypatch.setattr(trial_process, "_READ", code)
    monkeypatch.setattr(trial_process, "TRIAL_S", 0.5)
    path = tmp_path / "t.h5"
    path.write_bytes(code.encode())
    with pytest.raises(InputError, match=message):
        trial_process.require_harmless_transform(path)


def test_memory_is_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial_process, "_LOAD", "")
    monkeypatch.setattr(trial_process, "_READ", "bytes(1 << 30)")
    (tmp_path / "t.h5").touch()
    trial_process.require_harmless_transform(tmp_path / "t.h5")
    monkeypatch.setattr(trial_process, "MEMORY_BYTES", 1 << 29)
    (tmp_path / "u.h5").touch()
    with pytest.raises(InputError, match="cannot be read as one"):
        trial_process.require_harmless_transform(tmp_path / "u.h5")


@pytest.fixture
def trials(monkeypatch: pytest.MonkeyPatch) -> Iterator[trial_process._Trials]:
    """Trials of their own, whose reader fails for a file that is not there."""
    monkeypatch.setattr(trial_process, "_LOAD", "import time")
    monkeypatch.setattr(trial_process, "_READ", "time.sleep(60) if path == 'slow' else open(path)")
    made = trial_process._Trials()
    yield made
    made.end()


def test_one_process_reads_every_file_and_each_is_answered_for_itself(
    trials: trial_process._Trials, tmp_path: Path
) -> None:
    there = tmp_path / 'a name\nof two lines, \udcff "quoted".h5'
    there.touch()
    codes = [trials.end_of_reading(path, 60.0) for path in (there, tmp_path / "missing.h5", there)]
    first = trials._process
    assert codes == [0, 1, 0]
    assert trials.end_of_reading(there, 60.0) == 0
    assert trials._process is first


def test_a_process_that_was_ended_is_replaced(trials: trial_process._Trials, tmp_path: Path) -> None:
    (tmp_path / "t.h5").touch()
    assert trials.end_of_reading(tmp_path / "t.h5", 60.0) == 0
    trials._process.kill()
    trials._process.wait()
    assert trials.end_of_reading(tmp_path / "t.h5", 60.0) == 0


def test_after_an_interrupt_no_file_gets_the_answer_of_another(
    trials: trial_process._Trials, tmp_path: Path
) -> None:
    (tmp_path / "t.h5").touch()
    assert trials.end_of_reading(tmp_path / "t.h5", 60.0) == 0
    process = trials._process

    def interrupt(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        with pytest.raises(KeyboardInterrupt):
            trials.end_of_reading(Path("slow"), 60.0)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert process.poll() == -signal.SIGKILL
    assert trials.end_of_reading(tmp_path / "missing.h5", 60.0) == 1
    assert trials.end_of_reading(tmp_path / "t.h5", 60.0) == 0


def test_it_ends_with_the_process_that_asked(tmp_path: Path) -> None:
    (tmp_path / "t.h5").touch()
    code = (
        "import os, pathlib, signal, sys\n"
        "from registration.io import trial_process\n"
        "trial_process._LOAD, trial_process._READ = '', 'open(path)'\n"
        "trials = trial_process._Trials()\n"
        "assert trials.end_of_reading(pathlib.Path(sys.argv[1]), 60.0) == 0\n"
        "print(trials._process.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "t.h5")], capture_output=True, check=False
    )
    process = Path("/proc") / done.stdout.decode().strip()
    assert done.returncode == -signal.SIGKILL
    assert process.name.isdigit()
    assert ended(process)


def ended(process: Path, within_s: float = 10.0) -> bool:
    """Whether the process is gone, or only waits for somebody to ask how it ended."""
    until = time.monotonic() + within_s
    while time.monotonic() < until:
        try:
            state = (process / "stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":
            return True
        time.sleep(0.02)
    return False
