"""Configurations of San Raffaele: what a job trains on, the common test subjects, and what the summary says."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from drawn_sweeps import draw_sweeps
from scored_cases import scored_cases

from experiments.datasets.san_raffaele import SanRaffaele
from experiments.datasets.simulated import SimulatedSubstitute
from experiments.datasets.usgra import Usgra
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Silent
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split import Split
from experiments.studies.dataset_variability import study as variability
from models.errors import InputError as ModelInputError
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.initialisation import SharedRandom
from models.training.losses import DiceCrossEntropy
from models.training.settings import TrainerSettings

CONFIGURATIONS = tuple(variability.CONFIGURATIONS)
TRAINED = ["single_session", "full"]


def config(**changes: Any) -> dict[str, Any]:
    split = {"_target_": "experiments.splits.group_splits.GroupSplits", "folds": 2}
    dataset = {"_target_": "experiments.datasets.san_raffaele.SanRaffaele", "root": "none", "simulate": True}
    return {
        "split": split, "dataset": dataset, "configurations": list(CONFIGURATIONS), "fold": None, **changes,
    }  # fmt: skip


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> SanRaffaele:
    small = SimulatedSubstitute(
        subjects=10, recordings=1, frames=2, size_px=32, cache=str(tmp_path_factory.mktemp("cache"))
    )
    return SanRaffaele("none", simulate=True, substitute=small, blocks=4, gap_frames=1)


@pytest.fixture(scope="module")
def results(
    dataset: SanRaffaele, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[list[tuple[JobResult, Outcome]]]:
    with pytest.MonkeyPatch.context() as patch:
        draw_sweeps(patch)
        patch.setenv("CTUS_HOME", str(tmp_path_factory.mktemp("project")))
        found = []
        for job in variability.jobs(config(fold=0, configurations=TRAINED)):
            workspace = tmp_path_factory.mktemp("job")
            outcome = variability.run(
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
            found.append((JobResult({**config(), **job}, outcome.metrics, outcome.cases, workspace), outcome))
        yield found


def test_a_job_for_each_configuration_and_fold() -> None:
    assert variability.jobs(config()) == [
        {"configurations": [name], "fold": fold} for name in CONFIGURATIONS for fold in (0, 1)
    ]
    assert variability.jobs(config(configurations=["pruned"], fold=1)) == [
        {"configurations": ["pruned"], "fold": 1}
    ]


def test_all_configurations_are_scored_on_the_same_cases_and_train_on_none_of_their_groups(
    results: list[tuple[JobResult, Outcome]], dataset: SanRaffaele
) -> None:
    tested = set()
    for result, outcome in results:
        cases, split = outcome.cases, Split.read(result.workspace / "split.json")
        assert cases is not None
        test = cases[cases["part"] == "held_out"]
        tested.add(tuple(test["case_id"]))
        assert set(test["group"]) == set(dataset.test_groups())
        seen = {split.groups[case] for case in (*split.train, *split.validation)}
        assert not seen & set(cases["group"])
        assert set(cases["configuration"]) == set(result.config["configurations"])
        assert outcome.tags["configuration"] == result.config["configurations"][0]
        assert result.metrics["train_cases"] == len(split.train)
    assert len(tested) == 1


def test_full_is_subsampled_to_the_size_of_the_others(
    dataset: SanRaffaele, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_sweeps(monkeypatch)
    sizes = {name: len(variability.configured(dataset, [name])().case_ids) for name in CONFIGURATIONS}
    assert sizes["full_as_single_session"] == sizes["single_session"] < sizes["full_as_pruned"]
    assert sizes["full_as_pruned"] == sizes["pruned"] < sizes["full"]


def test_the_summary_says_what_was_varied_and_that_it_is_not_comparable(
    results: list[tuple[JobResult, Outcome]],
) -> None:
    outcome = variability.summarise([result for result, _ in results])
    test = outcome.tables["common test subjects"]
    assert list(test["configuration"]) == TRAINED
    assert set(test["data"]) == {"simulated, not comparable"}
    assert test["published"].tolist() == ["> 82 %", ""]
    assert (test["train_cases"] > 0).all()
    assert set(outcome.tables["own unseen cases"]["data"]) == {"simulated, not comparable"}
    assert "comparison on the common test subjects" in outcome.tables
    assert set(outcome.figures) == {"variability"}
    assert "simulated, not comparable" in outcome.figures["variability"].get_suptitle()
    said = " ".join(outcome.findings)
    for varied in ("imaging depth", "gain", "frequency", "speckle size", "vessel shape", "changes no image"):
        assert varied in said
    assert outcome.metrics["full/unet/dsc_n"] > 0


def test_a_lower_score_of_full_is_found_by_pairs_of_groups() -> None:
    gains = {"single_session": 0.1, "full": -0.1, "pruned": 0.0}
    results = []
    for name, gain in gains.items():
        cases = scored_cases({"unet3plus": gain}, groups=10).assign(
            configuration=name, part="held_out", simulated=False
        )
        own = scored_cases({"unet3plus": 0.2}, groups=3).assign(
            configuration=name, part="out_of_fold", simulated=False
        )
        both = pd.concat([cases, own])
        results.append(JobResult({"configurations": [name]}, {"train_cases": 10.0}, both, Path()))
    outcome = variability.summarise(results)
    pairs = outcome.tables["comparison on the common test subjects"].set_index(["metric", "models"])
    assert pairs.loc[("dsc", "single_session - full"), "verdict"] == "single_session better"
    assert pairs.loc[("dsc", "full - pruned"), "verdict"] == "pruned better"
    test = outcome.tables["common test subjects"].set_index("configuration")
    assert test["published"].to_dict() == {"single_session": "> 82 %", "full": "down to 61.4 %", "pruned": ""}
    assert set(test["data"]) == {""}
    assert any("performance partially recovered" in sentence for sentence in outcome.findings)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"configurations": []}, "configurations: expected a list of configurations"),
        ({"configurations": "full"}, "configurations: expected a list of configurations, received 'full'"),
        ({"configurations": ["half"]}, "configurations: expected each one of single_session, full"),
        ({"fold": 2}, "fold: expected 0 to 1, or null for all, received 2"),
        (
            {"split": {"_target_": "experiments.splits.group_splits.GroupSplits", "outer_folds": 2}},
            "split: expected folds of every configuration alike",
        ),
        (
            {"dataset": {"_target_": "experiments.datasets.usgra.Usgra", "root": "none"}},
            "dataset: expected san_raffaele, which has configurations",
        ),
    ],
)
def test_refuses_what_is_no_job(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        variability.jobs(config(**changes))


def test_an_image_size_that_does_not_fit_is_refused_before_any_fold(dataset: SanRaffaele) -> None:
    parts: dict[str, Any] = {"configurations": ["full"], "model": UNet(4, 3), "init": SharedRandom()}
    variability.check(dataset=dataset, preprocessing=Preprocessing(32), **parts)
    with pytest.raises(ModelInputError, match="image size"):
        variability.check(dataset=dataset, preprocessing=Preprocessing(30), **parts)
    with pytest.raises(InputError, match="expected the folder of data set san_raffaele_full"):
        variability.check(
            dataset=SanRaffaele("none", subset="pruned"), preprocessing=Preprocessing(32), **parts
        )
    with pytest.raises(InputError, match="dataset: expected san_raffaele"):
        variability.check(dataset=Usgra("none"), preprocessing=Preprocessing(32), **parts)
