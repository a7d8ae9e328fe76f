"""What a job asks Slurm for: the options there are, what is refused, and nothing that a shell would run."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from configurations import CONF, LAUNCHERS, mandatory

from experiments.cli import compose_sweep
from experiments.errors import InputError
from experiments.running.launcher_choice import slurm_settings
from experiments.running.slurm_settings import SlurmSettings


def composed(*words: str) -> dict[str, Any]:
    ((config, _),) = compose_sweep(["study=ct_model", *mandatory("ct_model"), *words])
    return dict(config)


def test_each_option_shows_every_setting_and_differs_where_it_means_to() -> None:
    assert LAUNCHERS == ["local", "slurm", "slurm_gpu"]
    assert composed()["launcher"] == {"kind": "local"}
    differing = {}
    for name in ("slurm", "slurm_gpu"):
        config = composed(f"launcher={name}")
        assert set(config["launcher"]) - {"kind"} == {one.name for one in fields(SlurmSettings)}
        built = slurm_settings(config)
        differing[name] = {
            one.name
            for one in fields(SlurmSettings)
            if getattr(built, one.name) != getattr(SlurmSettings(), one.name)
        }
    assert differing == {"slurm": set(), "slurm_gpu": {"cpus", "memory_gb", "gpus"}}


def test_names_of_the_cluster_are_text_whatever_they_look_like() -> None:
    config = composed("launcher=slurm", "launcher.partition=01", "launcher.account=1e3")
    assert (config["launcher"]["partition"], config["launcher"]["account"]) == ("01", "1e3")


def test_they_become_what_sbatch_takes() -> None:
    settings = SlurmSettings(
        partition="long",
        timeout_min=30,
        memory_gb=1.5,
        gpus=1,
        sbatch={"constraint": "a100&ib", "exclusive": True},
    )
    parameters = settings.parameters("ctus segment/x")
    assert parameters["job_name"] == "ctus-segment-x" and parameters["mem"] == "1536M"
    assert (parameters["time"], parameters["gpus_per_node"], parameters["partition"]) == (30, 1, "long")
    assert parameters["additional_parameters"] == {
        "requeue": True,
        "constraint": "a100&ib",
        "exclusive": True,
    }
    assert "account" not in parameters and "qos" not in parameters
    assert "gpus_per_node" not in SlurmSettings().parameters("x")
    assert SlurmSettings(requeue=False).parameters("x")["additional_parameters"] == {"no-requeue": True}


def test_a_short_job_is_warned_later() -> None:
    assert SlurmSettings(timeout_min=240).parameters("x")["signal_delay_s"] == 90
    assert SlurmSettings(timeout_min=5).parameters("x")["signal_delay_s"] == 30


def test_the_script_of_a_job_has_each_setting_on_one_line(tmp_path: Path) -> None:
    from submitit.slurm import slurm

    parameters = SlurmSettings(partition="a b", sbatch={"comment": "x & y"}).parameters("ctus")
    script = slurm._make_sbatch_string(command="true", folder=tmp_path, map_count=8, **parameters)
    lines = script.splitlines()
    assert (
        "#SBATCH --comment='x & y'" in lines
        and "#SBATCH --array=0-7%8" in lines
        and "#SBATCH --requeue" in lines
    )
    commands = [line for line in lines if line and not line.startswith("#")]
    assert len(commands) == 2 and commands[0].startswith("export ") and commands[1].endswith(" true")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"timeout_min": 0}, "launcher.timeout_min: expected at least 1, received 0"),
        ({"gpus": -1}, "launcher.gpus: expected a whole number from 0, received -1"),
        ({"memory_gb": 0.0}, "launcher.memory_gb: expected a positive number"),
        ({"poll_s": float("inf")}, "launcher.poll_s: expected a positive number"),
        (
            {"requeue": False, "timeout_requeues": 1},
            "launcher.timeout_requeues: expected 0 with requeue=false",
        ),
        ({"partition": "x\nrm -rf"}, "launcher.partition: expected letters"),
        ({"sbatch": {"comment": "x\ntouch /tmp/owned"}}, "launcher.sbatch.comment: expected letters"),
        ({"sbatch": {"comment": "$(touch owned)"}}, "launcher.sbatch.comment: expected letters"),
        ({"sbatch": {"x\ntouch owned": 1}}, "launcher.sbatch: expected long names"),
        ({"sbatch": {"output": "/etc/passwd"}}, "expected none that the launcher sets, received output"),
        ({"sbatch": {"wrap": "touch owned"}}, "expected none that the launcher sets, received wrap"),
        ({"sbatch": {"time": 5}}, "received time; launcher.timeout_min sets it"),
        ({"sbatch": {"exclusive": False}}, "launcher.sbatch.exclusive: expected a text, a number, or true"),
        ({"sbatch": {"exclude": ["a"]}}, "launcher.sbatch.exclude: expected a text, a number, or true"),
    ],
)
def test_what_is_out_of_range_or_would_leave_its_line_is_refused(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as refusal:
        SlurmSettings(**settings)
    assert said in str(refusal.value)


def test_options_are_files_of_their_own() -> None:
    for name in LAUNCHERS:
        assert (CONF / "launcher" / f"{name}.yaml").read_text().startswith("# ")
