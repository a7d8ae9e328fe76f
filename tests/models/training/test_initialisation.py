"""Which weights a training starts from, and which starts are refused."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from models.checkpoint import Checkpoint
from models.errors import InputError
from models.networks.attention_unet import AttentionUNet
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing
from models.training.initialisation import Pretrained, SharedRandom
from models.training.training_data import NOTE, TrainingData, as_note, from_notes
from models.weights import weights_digest

RECIPE = UNet(width=4, depth=3)
CAROTID = TrainingData("carotid", "c0ffee", False, "CC BY 4.0")
PHANTOM = TrainingData("phantom", "5eed", True, "none (simulated)")


def checkpoint(path: Path, *data: TrainingData) -> Path:
    torch.manual_seed(3)
    notes = {NOTE: as_note(data)} if data else {}
    Checkpoint(RECIPE, RECIPE().state_dict(), Preprocessing(32), notes).save(path)
    return path


def test_random_weights_depend_on_the_seed_alone_and_leave_the_random_stream() -> None:
    torch.manual_seed(1)
    first, drawn = SharedRandom()(RECIPE, 5), torch.rand(1)
    torch.manual_seed(1)
    assert torch.equal(torch.rand(1), drawn)
    assert first.digest == SharedRandom()(RECIPE, 5).digest != SharedRandom()(RECIPE, 6).digest
    assert first.source == "random weights of seed 5" and first.trained_on == ()


def test_a_network_of_a_start_has_exactly_its_weights(tmp_path) -> None:
    path = checkpoint(tmp_path / "model.pt", CAROTID, PHANTOM)
    start = Pretrained(path)(RECIPE, 9)
    network = start.network(RECIPE)
    assert (
        weights_digest(network.state_dict()) == start.digest == weights_digest(Checkpoint.load(path).weights)
    )
    assert start.source == "weights trained on carotid, phantom (simulated)"
    assert start.trained_on == (CAROTID, PHANTOM)
    # Training one fold leaves the start of the next as it was.
    with torch.no_grad():
        next(network.parameters()).add_(1)
    assert weights_digest(start.network(RECIPE).state_dict()) == start.digest


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (UNet(width=8, depth=3), r"expected a unet with width 8 as the one to train, received width 4"),
        (
            UNet(width=4, depth=3, normalisation="instance"),
            r"expected a unet with normalisation instance .*, received normalisation batch",
        ),
        (AttentionUNet(width=4), r"expected a attention_unet, received a unet"),
    ],
)
def test_another_architecture_is_refused(tmp_path, model, message: str) -> None:
    init = Pretrained(checkpoint(tmp_path / "model.pt", CAROTID))
    with pytest.raises(InputError, match=rf"init\.path: {message}"):
        init.require_fit(model)
    with pytest.raises(InputError, match=message):
        init(model, 0)


@pytest.mark.parametrize(
    "seen",
    [TrainingData("carotid", "another copy"), TrainingData("folder", "c0ffee")],
    ids=["name", "digest"],
)
def test_a_start_that_has_seen_the_data_is_refused_unless_allowed(tmp_path, seen: TrainingData) -> None:
    path = checkpoint(tmp_path / "model.pt", PHANTOM, CAROTID)
    with pytest.raises(
        InputError, match=r"expected a network trained on other data than .*allow_seen_data=true"
    ):
        Pretrained(path).require_unseen([seen])
    Pretrained(path, allow_seen_data=True).require_unseen([seen])
    Pretrained(path).require_unseen([TrainingData("usgra", "1234")])


def test_a_start_that_does_not_say_what_it_has_seen_is_refused_unless_allowed(tmp_path) -> None:
    path = checkpoint(tmp_path / "model.pt")
    with pytest.raises(InputError, match="expected a network that names the data it was trained on"):
        Pretrained(path).require_unseen([CAROTID])
    Pretrained(path, allow_seen_data=True).require_unseen([CAROTID])


def test_a_path_must_be_given_and_hold_a_network(tmp_path) -> None:
    with pytest.raises(InputError, match=r"init\.path: expected the model\.pt .*, received null"):
        Pretrained().require_fit(RECIPE)
    with pytest.raises(InputError, match="expected a checkpoint file, found none"):
        Pretrained(tmp_path / "none.pt")(RECIPE, 0)


def test_records_of_data_survive_the_notes() -> None:
    assert from_notes({NOTE: as_note((CAROTID, PHANTOM, CAROTID))}) == (CAROTID, PHANTOM)
    assert from_notes({}) is None
    with pytest.raises(InputError, match="training_data: expected a list of data sets"):
        from_notes({NOTE: "carotid"})
