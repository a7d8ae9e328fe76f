"""A network trained on whole data sets: what it saw and how it is used as a start."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from drawn_vessels import drawn_frames

from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.studies import pretrain
from models.checkpoint import Checkpoint
from models.errors import InputError as ModelInputError
from models.labelled_frames import LabelledFrames
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.initialisation import Pretrained, SharedRandom
from models.training.losses import DiceCrossEntropy
from models.training.settings import TrainerSettings
from models.training.training_data import TrainingData, from_notes

PARTS = {"model": UNet(width=4, depth=3), "preprocessing": Preprocessing(32), "init": SharedRandom()}


@dataclasses.dataclass(frozen=True)
class Drawn:
    name: str = "drawn"
    seed: int = 0
    count: int = 15
    licence: str = "CC0"
    simulated: bool = False

    def __call__(self) -> LabelledFrames:
        frames = drawn_frames(self.count, seed=self.seed)
        return dataclasses.replace(frames, simulated=self.simulated)


@pytest.fixture(scope="module", autouse=True)
def project_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CTUS_HOME", str(tmp_path_factory.mktemp("project")))
        yield


def run(workspace: Path, dataset: Drawn, also: Drawn | None = None, **changes: object) -> Outcome:
    given = {
        **PARTS,
        "trainer": TrainerSettings(max_epochs=2, batch_size=4, learning_rate=0.01, patience=2),
        "augmentation": Augmentation(),
        "loss": DiceCrossEntropy(),
        "validation_parts": 5,
        "seed": 0,
    }
    return pretrain.run(
        **{**given, **changes}, dataset=dataset, also=also, workspace=workspace, progress=Silent()
    )


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    workspace = tmp_path_factory.mktemp("pretrained")
    return workspace, run(workspace, Drawn(), Drawn("simulator", seed=5, simulated=True))


def test_the_network_says_what_it_was_trained_on(both: tuple[Path, Outcome]) -> None:
    workspace, outcome = both
    expected = (
        TrainingData("drawn", Drawn()().digest(), False, "CC0"),
        TrainingData("simulator", Drawn(seed=5, simulated=True)().digest(), True, "none (simulated)"),
    )
    assert from_notes(Checkpoint.load(workspace / "model.pt").notes) == expected
    record = json.loads((workspace / "pretraining.json").read_text())
    assert [each["name"] for each in record["training_data"]] == ["drawn", "simulator"]
    assert record["epochs"] == 2 and record["init"] == "shared_random"
    assert (
        outcome.tags["dataset"] == "drawn and simulator (simulated)" and outcome.tags["simulated"] == "true"
    )
    assert "simulator (simulated)" in outcome.findings[0]
    assert [each.name for each in outcome.inputs] == ["drawn", "simulator"]


def test_whole_groups_of_each_data_set_are_kept_to_choose_the_epoch(both: tuple[Path, Outcome]) -> None:
    record = json.loads((both[0] / "pretraining.json").read_text())
    kept = record["validation_groups"]
    assert {group.split("/")[0] for group in kept} == {"drawn", "simulator"}
    # Three frames a group, five groups a data set.
    assert record["cases"] == 30 - 3 * len(kept) and 2 <= len(kept) <= 4


def test_it_starts_another_data_set_and_refuses_its_own(both: tuple[Path, Outcome]) -> None:
    init = Pretrained(both[0] / "model.pt")
    pretrain.check(**{**PARTS, "init": init}, dataset=Drawn("other"), also=None, validation_parts=5)
    for name in ("drawn", "simulator"):
        with pytest.raises(ModelInputError, match=f"trained on other data than {name}"):
            pretrain.check(**{**PARTS, "init": init}, dataset=Drawn(name), also=None, validation_parts=5)


def test_a_second_training_names_both_lines_of_data(both: tuple[Path, Outcome], tmp_path: Path) -> None:
    init = Pretrained(both[0] / "model.pt")
    run(tmp_path, Drawn("third", seed=9), init=init)
    notes = Checkpoint.load(tmp_path / "model.pt").notes
    assert [each.name for each in from_notes(notes) or ()] == ["drawn", "simulator", "third"]
    assert notes["start_source"] == "weights trained on drawn, simulator (simulated)"


def test_the_same_data_under_another_name_is_refused(both: tuple[Path, Outcome], tmp_path: Path) -> None:
    with pytest.raises(ModelInputError, match="trained on other data than renamed"):
        run(tmp_path, Drawn("renamed"), init=Pretrained(both[0] / "model.pt"))


def test_refuses_too_few_groups_and_one_name_twice(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"drawn: expected at least 2 groups, .* received 1"):
        run(tmp_path, Drawn(count=3))
    with pytest.raises(InputError, match="also: expected a data set of another name than dataset"):
        pretrain.check(**PARTS, dataset=Drawn(), also=Drawn(seed=1), validation_parts=5)
    with pytest.raises(InputError, match="validation_parts: expected at least 2, received 1"):
        pretrain.check(**PARTS, dataset=Drawn(), also=None, validation_parts=1)
