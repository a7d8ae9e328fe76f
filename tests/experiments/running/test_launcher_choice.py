"""Which launcher a configuration asks for, and the settings that go with none."""

from __future__ import annotations

from pathlib import Path

import pytest
from pretended_slurm import pretend

from experiments.cli import compose_sweep
from experiments.errors import InputError
from experiments.running import launcher_choice
from experiments.running.jobs import Job
from experiments.running.launcher import InProcess
from experiments.running.launcher_choice import at_once, launcher_of, require_known
from experiments.running.local_processes import LocalProcesses
from experiments.running.slurm_launcher import SlurmLauncher
from experiments.running.slurm_settings import SlurmSettings

THREE = [Job({}, key, key) for key in "abc"]
SLURM = {"kind": "slurm", "array_parallelism": 2}


def test_each_kind_has_its_launcher(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch)
    assert launcher_of({"launcher": {"kind": "local"}}, THREE) == InProcess()
    assert launcher_of({"launcher": {"kind": "local"}, "jobs": 8}, THREE) == LocalProcesses(3)
    assert launcher_of({"jobs": 8}, THREE[:1]) == InProcess()
    found = launcher_of({"launcher": SLURM}, THREE)
    assert isinstance(found, SlurmLauncher) and found.settings == SlurmSettings(array_parallelism=2)


def test_how_many_run_at_a_time_is_a_setting_of_each() -> None:
    assert at_once({"jobs": 2}, THREE) == 2 and at_once({"jobs": 8}, THREE) == 3
    assert at_once({"launcher": SLURM}, THREE) == 2
    assert at_once({"launcher": {**SLURM, "array_size": 1}}, THREE) == 1


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"jobs": True}, "jobs: expected a whole number from 1"),
        ({"launcher": "slurm"}, "launcher: expected settings of a launcher, received 'slurm'"),
        (
            {"launcher": {"kind": "slrum"}},
            "launcher.kind: expected one of local, slurm, received 'slrum'; did you",
        ),
        ({"launcher": {"kind": "slurm", "cpus": "four"}}, "launcher.cpus: expected a whole number"),
        ({"launcher": {"kind": "slurm", "node": 4}}, "received node"),
        ({"launcher": SLURM, "jobs": 2}, "jobs: expected 1 with launcher=slurm"),
    ],
)
def test_settings_that_are_none_are_refused(config: dict, said: str) -> None:
    with pytest.raises(InputError) as refusal:
        require_known(config)
    assert said in str(refusal.value)


def test_runs_of_earlier_versions_have_no_launcher() -> None:
    require_known({"study": "x"})
    assert launcher_choice.jobs_at_once({}) == 1


def test_further_options_of_sbatch_are_given_on_the_command_line() -> None:
    words = ["study=segmentation", "dataset=phantom", "launcher=slurm", "launcher.sbatch={constraint: a100}"]
    ((config, _),) = compose_sweep(words)
    assert launcher_choice.slurm_settings(config).sbatch == {"constraint": "a100"}
