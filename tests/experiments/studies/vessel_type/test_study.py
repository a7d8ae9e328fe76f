"""Vessels and districts of Mus-V: the jobs, what each trains on, and where a case was taken."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from drawn_sweeps import draw_sweeps

from experiments.datasets.musv import MusV
from experiments.datasets.simulated import SimulatedSubstitute
from experiments.datasets.usgra import Usgra
from experiments.errors import InputError
from experiments.outcome import JobResult, Silent
from experiments.splits.group_splits import GroupSplits
from experiments.studies.vessel_type import study as vessel_type
from models.errors import InputError as ModelInputError
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.initialisation import SharedRandom
from models.training.losses import DiceCrossEntropy
from models.training.settings import TrainerSettings

MUSV = "experiments.datasets.musv.MusV"


def config(**changes: Any) -> dict[str, Any]:
    split = {"_target_": "experiments.splits.group_splits.GroupSplits", "folds": 2}
    dataset = {"_target_": MUSV, "root": "none", "target": "artery", "simulate": True}
    return {
        "split": split, "dataset": dataset, "vessels": ["artery", "vein"],
        "districts": ["carotid", "femoral", "aggregated"], "fold": None, **changes,
    }  # fmt: skip


def test_a_job_for_each_vessel_district_and_fold() -> None:
    assert vessel_type.jobs(config()) == [
        {"vessels": [vessel], "districts": [district], "fold": fold}
        for vessel in ("artery", "vein")
        for district in ("carotid", "femoral", "aggregated")
        for fold in (0, 1)
    ]


def test_a_job_trains_on_its_vessel_and_district_and_says_where_each_case_was_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_sweeps(monkeypatch)
    monkeypatch.setenv("CTUS_HOME", str(tmp_path))
    maker = SimulatedSubstitute(subjects=4, recordings=1, frames=2, size_px=32, cache=str(tmp_path / "cache"))
    dataset = MusV("none", "artery", simulate=True, substitute=maker)
    (job,) = vessel_type.jobs(config(vessels=["vein"], districts=["aggregated"], fold=1))
    workspace = tmp_path / "job"
    workspace.mkdir()
    outcome = vessel_type.run(
        dataset=dataset,
        split=GroupSplits(2),
        model=UNet(width=4, depth=2),
        preprocessing=Preprocessing(32),
        trainer=TrainerSettings(max_epochs=1, batch_size=4, learning_rate=0.01, patience=1),
        augmentation=Augmentation(transforms=()),
        loss=DiceCrossEntropy(),
        init=SharedRandom(),
        seed=0,
        workspace=workspace,
        progress=Silent(),
        **job,
    )
    cases = outcome.cases
    assert cases is not None
    assert set(cases["dataset"]) == {"musv_vein"} and set(cases["trained_on"]) == {"aggregated"}
    # Two sequences of a subject: the neck first, then the groin.
    assert [case[:3] in ("001", "003", "005", "007") for case in cases["case_id"]] == [
        district == "carotid" for district in cases["district"]
    ]
    assert set(cases["district"]) == {"carotid", "femoral"} and set(cases["data"]) == {""}
    assert outcome.tags["vessel"] == "vein" and outcome.tags["trained_on"] == "aggregated"
    said = vessel_type.summarise([JobResult({**config(), **job}, outcome.metrics, cases, workspace)])
    assert set(said.tables["vessel types"]["data"]) == {"simulated, not comparable"}
    assert any("Varied between the 8 simulated recordings: vessel shape" in one for one in said.findings)


def test_the_data_set_of_a_job() -> None:
    dataset = MusV("none", "artery", simulate=True)
    assert vessel_type.part_of(dataset, ["vein"], ["femoral"]).name == "musv_vein_femoral"
    assert vessel_type.part_of(dataset, ["artery"], ["aggregated"]).name == "musv_artery"
    real = replace(dataset, simulate=False)
    assert vessel_type.part_of(real, ["vein"], ["aggregated"]).name == "musv_vein"
    assert real.districts(["1_000"]) == ("",)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"vessels": []}, "vessels: expected a list of vessels"),
        ({"districts": "carotid"}, "districts: expected a list of districts, received 'carotid'"),
        ({"fold": 2}, "fold: expected 0 to 1, or null for all, received 2"),
        (
            {"split": {"_target_": "experiments.splits.group_splits.GroupSplits", "outer_folds": 2}},
            "split: expected folds of every district alike",
        ),
    ],
)
def test_refuses_what_is_no_job(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        vessel_type.jobs(config(**changes))


def test_an_image_size_that_does_not_fit_is_refused_before_any_fold() -> None:
    parts: dict[str, Any] = {
        "vessels": ["vein"], "districts": ["carotid"], "model": UNet(4, 3), "init": SharedRandom(),
    }  # fmt: skip
    dataset = MusV("none", "artery", simulate=True)
    vessel_type.check(dataset=dataset, preprocessing=Preprocessing(32), **parts)
    with pytest.raises(ModelInputError, match="image size"):
        vessel_type.check(dataset=dataset, preprocessing=Preprocessing(30), **parts)


@pytest.mark.parametrize(
    ("dataset", "vessel", "district", "message"),
    [
        (
            MusV("none", "artery"),
            "nerve",
            "aggregated",
            "vessels: expected each one of vein, artery, received",
        ),
        (
            MusV("none", "artery"),
            "vein",
            "all",
            "districts: expected each one of carotid, femoral, aggregated",
        ),
        (
            MusV("none", "artery"),
            "vein",
            "carotid",
            r"districts: expected \[aggregated\] where no table says what a sequence shows, received 'carotid'",
        ),
        (MusV("none", "artery"), "vein", "aggregated", "expected the folder of data set musv_vein"),
        (Usgra("none"), "vein", "aggregated", "dataset: expected musv_artery or musv_vein"),
    ],
)
def test_a_data_set_that_does_not_fit_is_refused_before_any_fold(
    dataset: Any, vessel: str, district: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        vessel_type.check(
            dataset=dataset,
            vessels=[vessel],
            districts=[district],
            model=UNet(4, 3),
            preprocessing=Preprocessing(32),
            init=SharedRandom(),
        )
