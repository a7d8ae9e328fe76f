"""An earlier configuration made one that can be run here, with new settings, paths and caches, or refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml
from vessels import bent_tube

from experiments.cli import compose_sweep
from experiments.errors import InputError
from experiments.studies.reproduce import configuration
from experiments.studies.reproduce.configuration import prepared, with_own_caches
from experiments.tracking.archive import without_folders
from experiments.tracking.run_record import RunRecord
from registration.io.surfaces import write_surface

COMMIT = {"mlflow.source.git.commit": "c" * 40}


def composed(folder: Path) -> dict[str, Any]:
    write_surface(folder / "tube.ply", bent_tube(30, 12))
    words = [f"target={folder / 'tube.ply'}", "overlaps=[1.0]", "rigid=[single_icp]", "trials=3"]
    ((config, _),) = compose_sweep(["study=robustness", *words])
    from experiments.running.jobs import job_configs

    ((job, _),) = job_configs(config)
    return job


def record(config: dict[str, Any] | None, name: str = "robustness") -> RunRecord:
    text = "" if config is None else yaml.safe_dump(config)
    empty = pd.DataFrame(columns=["metric", "step", "value", "timestamp_ms"])
    return RunRecord(
        "0123456789abcdef", "robustness", name, "FINISHED", 1, 2, None, COMMIT, {}, text, empty, None
    )


def test_a_configuration_of_today_is_taken_as_it_is(tmp_path: Path) -> None:
    config = composed(tmp_path)
    found = prepared(record(config), None)
    assert found.config == {**config, "resume": False}
    assert (found.lacking, found.moved) == ((), ())


def test_settings_that_came_later_are_taken_at_todays_default_and_named(tmp_path: Path) -> None:
    config = composed(tmp_path)
    whole = dict(config["perturbation"])
    del config["hand_centerlines"], config["perturbation"], config["rigid"]["single_icp"]["max_iterations"]
    found = prepared(record(config), None)
    assert found.config["hand_centerlines"] is False
    assert found.config["perturbation"] == whole
    assert found.lacking[0] == "hand_centerlines=False"
    assert any(said.startswith("rigid.single_icp.max_iterations=") for said in found.lacking)


def test_a_new_setting_without_a_plain_default_is_refused(tmp_path: Path) -> None:
    ((config, _),) = compose_sweep(["study=consistency", "phantoms=[vein]"])
    earlier = {key: value for key, value in config.items() if key != "phantom"}
    with pytest.raises(InputError, match="lacks the setting phantom, which is new and has no plain default"):
        prepared(record(earlier), None)


def gone_class(config: dict[str, Any]) -> None:
    config["perturbation"]["_target_"] = "registration.gone.Gone"


def gone_setting(config: dict[str, Any]) -> None:
    config["perturbation"]["wobble_mm"] = 1.0


def gone_study(config: dict[str, Any]) -> None:
    config["study"] = "forgotten"


def several_jobs(config: dict[str, Any]) -> None:
    config["overlaps"] = [1.0, 0.6]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (gone_class, "received 'registration.gone.Gone'"),
        (gone_setting, "wobble_mm"),
        (gone_study, "received 'forgotten'"),
        (several_jobs, "expected the configuration of one of 2 jobs"),
    ],
)
def test_what_this_version_does_not_take_is_said_with_the_commit_that_did(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], sentence: str
) -> None:
    config = composed(tmp_path)
    change(config)
    with pytest.raises(InputError) as refusal:
        prepared(record(config), None)
    assert str(refusal.value).startswith("run 0123456789ab: this version can't take its configuration")
    assert "it was made at commit cccccccccccc" in str(refusal.value)
    assert sentence in str(refusal.value)


@pytest.mark.parametrize("text", [None, {"seed": 1}])
def test_a_run_without_a_configuration_is_refused(text: dict[str, Any] | None) -> None:
    with pytest.raises(InputError, match="expected a run with a configuration"):
        prepared(record(text), None)


def test_data_are_looked_for_under_data_root_by_the_end_of_their_path(tmp_path: Path) -> None:
    config = composed(tmp_path)
    original = str(tmp_path / "tube.ply")
    archived = yaml.safe_load(without_folders(yaml.safe_dump(config)))
    assert archived["target"] == ".../tube.ply"
    with pytest.raises(InputError, match=r"what it read is not here \(.../tube.ply\); data_root="):
        prepared(record(archived), None)
    found = prepared(record(archived), tmp_path)
    assert found.config["target"] == original
    assert found.moved == (f".../tube.ply -> {original}",)
    # The longest end that is there is taken: of two files of one name, that in the folder of the same name.
    (tmp_path / "inner" / tmp_path.name).mkdir(parents=True)
    for place in (tmp_path / "inner", tmp_path / "inner" / tmp_path.name):
        write_surface(place / "tube.ply", bent_tube(30, 12))
    longest = tmp_path / "inner" / tmp_path.name / "tube.ply"
    assert prepared(record(config), tmp_path / "inner").config["target"] == str(longest)


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("robustness", ""),
        ("seed=0,rigid=single_icp,overlaps=1.0,places=middle", "seed=0"),
        ("seed=[1,2],rigid=single_icp,overlaps=1.0,places=middle,job=0123456789ab", "seed=[1,2]"),
        ("usgra: unet", ""),
    ],
)
def test_the_choices_of_a_run_are_those_of_its_name_less_its_jobs_own(
    tmp_path: Path, name: str, label: str
) -> None:
    from experiments.running.jobs import job_configs

    config = composed(tmp_path)
    ((_, change),) = job_configs(config)
    named = name.replace("rigid=single_icp,overlaps=1.0,places=middle", change)
    assert prepared(record(config, named), None).label == label


@pytest.mark.parametrize(("device", "accelerator"), [("cpu", "cpu"), ("cuda", "gpu")])
def test_a_run_of_a_gpu_is_made_on_the_cpu_where_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device: str, accelerator: str
) -> None:
    monkeypatch.setattr(configuration, "device_of", lambda _: device)
    # A setting that the study does not take changes nothing else.
    found = prepared(record({**composed(tmp_path), "trainer": {"accelerator": "gpu"}}), None)
    assert found.config["trainer"]["accelerator"] == accelerator
    assert found.without_gpu == (device == "cpu")


def test_every_cache_gets_an_empty_place_of_its_own() -> None:
    config = {
        "dataset": {"cache": "/home/a/.cache/phantom", "substitute": [{"cache": ".../x"}], "root": "/d"}
    }
    assert with_own_caches(config, Path("/new")) == {
        "dataset": {"cache": "/new/phantom", "substitute": [{"cache": "/new/x"}], "root": "/d"}
    }
    assert with_own_caches({"cache": None}, Path("/new")) == {"cache": None}
