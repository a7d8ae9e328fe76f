"""The table of train and test domain: every case of both data sets scored by networks that have not seen its group."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest
from drawn_vessels import drawn_frames
from scored_cases import scored_cases

from experiments.datasets.usgra import Usgra
from experiments.errors import InputError
from experiments.outcome import JobResult, Silent
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split import Split
from experiments.studies.domain_transfer import study as domain_transfer
from models.checkpoint import Checkpoint
from models.errors import InputError as ModelInputError
from models.labelled_frames import LabelledFrames
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.initialisation import Pretrained, SharedRandom
from models.training.losses import DiceCrossEntropy
from models.training.settings import TrainerSettings
from models.training.training_data import NOTE, TrainingData, as_note


@dataclass(frozen=True)
class Drawn:
    """Drawn vessels under a name; ``inverted`` swaps light and dark, so that the two don't look alike."""

    name: str
    inverted: bool = False

    def __call__(self) -> LabelledFrames:
        frames = drawn_frames(18, empty=0)
        if not self.inverted:
            return frames
        return LabelledFrames(**{**vars(frames), "images": tuple(255 - image for image in frames.images)})


LIGHT, DARK = Drawn("light"), Drawn("dark", inverted=True)


def config(**changes: object) -> dict[str, object]:
    split = {"_target_": "experiments.splits.group_splits.GroupSplits", "folds": 2}
    node = {"_target_": "experiments.datasets.phantom.Phantom"}
    return {"split": split, "first": node, "second": node, "train_on": None, "fold": None, **changes}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[JobResult]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CTUS_HOME", str(tmp_path_factory.mktemp("project")))
        found = []
        for job in domain_transfer.jobs(config()):
            workspace = tmp_path_factory.mktemp("job")
            outcome = domain_transfer.run(
                first=LIGHT,
                second=DARK,
                split=GroupSplits(2),
                model=UNet(width=8, depth=3),
                preprocessing=Preprocessing(32),
                trainer=TrainerSettings(max_epochs=12, batch_size=4, learning_rate=0.01, patience=12),
                augmentation=Augmentation(),
                loss=DiceCrossEntropy(),
                init=SharedRandom(),
                seed=0,
                workspace=workspace,
                progress=Silent(),
                **job,
            )
            found.append(JobResult({**config(), **job}, outcome.metrics, outcome.cases, workspace))
        yield found


def cases_of(results: list[JobResult]) -> pd.DataFrame:
    return pd.concat([result.cases for result in results if result.cases is not None])


def test_a_job_for_each_domain_and_fold() -> None:
    assert domain_transfer.jobs(config()) == [
        {"train_on": domain, "fold": fold} for domain in ("first", "second") for fold in (0, 1)
    ]
    assert domain_transfer.jobs(config(train_on="second", fold=1)) == [{"train_on": "second", "fold": 1}]


def test_every_case_of_both_is_scored_once_by_each_and_unseen(results: list[JobResult]) -> None:
    cases = cases_of(results)
    for (_, tested), part in cases.groupby(["train_dataset", "dataset"]):
        assert sorted(part["case_id"]) == sorted(LIGHT().case_ids), tested
    for result in results:
        split = Split.read(result.workspace / "split.json")
        seen = {split.groups[case] for case in (*split.train, *split.validation)}
        scored = cases_of([result])
        own = scored[scored["dataset"] == scored["train_dataset"]]
        assert not seen & set(own["group"])


def test_the_table_has_both_domains_both_ways(results: list[JobResult]) -> None:
    outcome = domain_transfer.summarise(results)
    table = outcome.tables["transfer"]
    pairs = {(row["trained_on"], row["tested_on"]): row["dsc_mean"] for row in table.to_dict("records")}
    assert set(pairs) == {
        (f"{one} (simulated)", f"{other} (simulated)")
        for one in ("light", "dark")
        for other in ("light", "dark")
    }
    assert set(table["model"]) == {"unet"}
    cases = cases_of(results)
    for (trained, tested), mean in pairs.items():
        own = cases[(cases["train_dataset"] == trained.split()[0]) & (cases["dataset"] == tested.split()[0])]
        assert mean == pytest.approx(own["dsc"].mean())
        assert outcome.metrics[f"dsc_mean/{trained.split()[0]}_to_{tested.split()[0]}"] == mean
    # A vessel that is dark in one domain and light in the other can't be known from the other alone.
    assert pairs["light (simulated)", "light (simulated)"] > pairs["light (simulated)", "dark (simulated)"]
    assert set(outcome.figures) == {"transfer"}
    assert outcome.findings


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"train_on": "third"}, "train_on: expected first, second, or null for both, received 'third'"),
        (
            {"second": "usgra"},
            "second: expected a data set, as dataset@second=phantom gives it, received 'usgra'",
        ),
        ({"fold": 2}, "fold: expected 0 to 1, or null for all, received 2"),
        (
            {"split": {"_target_": "experiments.splits.group_splits.GroupSplits", "outer_folds": 2}},
            "split: expected folds of both data sets alike",
        ),
    ],
)
def test_refuses_what_is_no_job(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        domain_transfer.jobs(config(**changes))


def test_refuses_two_data_sets_of_one_name_and_a_missing_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="second: expected a data set of another name than first"):
        domain_transfer.check(
            first=LIGHT, second=LIGHT, model=UNet(8), preprocessing=Preprocessing(64), init=SharedRandom()
        )
    missing = Usgra(str(tmp_path / "none"))
    with pytest.raises(InputError, match="expected the folder of data set usgra"):
        domain_transfer.check(
            first=LIGHT, second=missing, model=UNet(8), preprocessing=Preprocessing(64), init=SharedRandom()
        )
    with pytest.raises(ModelInputError, match="image size: expected sides that are multiples of 16"):
        domain_transfer.check(
            first=LIGHT, second=DARK, model=UNet(8), preprocessing=Preprocessing(50), init=SharedRandom()
        )


def test_a_start_that_has_seen_either_data_set_is_refused(tmp_path: Path) -> None:
    model = UNet(width=4, depth=2)
    note = {NOTE: as_note([TrainingData("dark", "of some copy")])}
    Checkpoint(model, model().state_dict(), Preprocessing(32), note).save(tmp_path / "model.pt")
    init = Pretrained(tmp_path / "model.pt")
    for pair in ({"first": LIGHT, "second": DARK}, {"first": DARK, "second": LIGHT}):
        with pytest.raises(ModelInputError, match="expected a network trained on other data than dark"):
            domain_transfer.check(**pair, model=model, preprocessing=Preprocessing(32), init=init)


def test_cases_without_any_vessel_keep_their_summary() -> None:
    parts = []
    for trained in ("a", "b"):
        for tested in ("a", "b"):
            cases = scored_cases({"unet": 0.0}, dataset=tested).assign(train_dataset=trained)
            parts.append(cases.assign(dsc=float("nan"), missed=float("nan"), hd95_px=float("nan")))
    jobs = [JobResult({"train_on": "first"}, {}, part, Path()) for part in parts]
    outcome = domain_transfer.summarise(jobs)
    assert not len(outcome.tables["transfer"]) and outcome.figures == {} and outcome.metrics == {}


def test_a_missing_folder_is_asked_for_by_the_place_of_the_data_set() -> None:
    with pytest.raises(InputError, match=r"pass second\.root=<folder>"):
        domain_transfer.check(
            first=Drawn("a"),
            second=Usgra(root="/no/such/folder"),
            model=UNet(width=4, depth=2),
            preprocessing=Preprocessing(image_size_px=32),
            init=SharedRandom(),
        )
