import dataclasses
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from drawn_vessels import drawn_frames
from filelock import FileLock

from models.checkpoint import Checkpoint
from models.errors import InputError
from models.evaluation import predict, score_cases
from models.networks.unet import UNet
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.datamodule import prepared
from models.training.fold import TrainedFold, train_fold
from models.training.initialisation import Pretrained, initial_network
from models.training.losses import DiceCrossEntropy
from models.training.segmenter import Segmenter
from models.training.settings import TrainerSettings
from models.training.spec import FoldTraining
from models.weights import weights_digest

RECIPE = UNet(width=4, depth=3)
# Wide enough for torch to divide sums among threads.
WIDE = UNet(width=16, depth=3)
TRAIN, VALIDATION = drawn_frames(16, seed=0), drawn_frames(6, seed=1)
MEASURED = ("images_per_s", "peak_memory_mb")


def settings(epochs: int, **changes: object) -> TrainerSettings:
    given = {"max_epochs": epochs, "batch_size": 4, "learning_rate": 0.01, "patience": epochs}
    return TrainerSettings(**{**given, **changes})


def trained(
    directory: Path,
    *,
    trainer: TrainerSettings | None = None,
    seed: int = 0,
    fold: int = 0,
    epochs: int = 2,
    state: Path | None = None,
    on_epoch=None,
    on_wait=None,
    **changes: object,
) -> TrainedFold:
    training = FoldTraining(
        train=TRAIN,
        validation=VALIDATION,
        preprocessing=Preprocessing(32),
        trainer=trainer or settings(epochs),
        augmentation=Augmentation(),
        loss=DiceCrossEntropy(),
        seed=seed,
        fold=fold,
        **{"model": RECIPE, **changes},
    )
    return train_fold(
        training, directory=directory, state_directory=state, on_epoch=on_epoch, on_wait=on_wait
    )


def weights(result: TrainedFold) -> dict[str, torch.Tensor]:
    return dict(Checkpoint.load(result.checkpoint).weights)


def same(first: dict[str, torch.Tensor], second: dict[str, torch.Tensor]) -> bool:
    return all(torch.equal(first[name], second[name]) for name in first)


def test_a_network_learns_to_find_drawn_vessels(tmp_path) -> None:
    unseen = drawn_frames(8, seed=2, size=(60, 44))
    result = trained(tmp_path, epochs=20)
    rows = score_cases(unseen, dict(predict(Predictor.load(result.checkpoint), unseen)), {})
    assert sum(row["dsc"] for row in rows) / len(rows) > 0.8
    assert result.history[-1]["train_loss"] < result.history[0]["train_loss"]


def test_the_checkpoint_is_that_of_the_best_epoch(tmp_path) -> None:
    reports: list[dict[str, float]] = []
    result = trained(tmp_path, epochs=4, on_epoch=reports.append)
    by_epoch = [epoch["validation_dsc"] for epoch in result.history]
    assert list(result.history) == reports and len(reports) == 4
    assert result.best_validation_dsc == max(by_epoch) == by_epoch[result.best_epoch]
    checkpoint = Checkpoint.load(result.checkpoint)
    assert checkpoint.recipe == RECIPE
    assert checkpoint.notes == {
        "seed": 0,
        "fold": 0,
        "epoch": result.best_epoch,
        "validation_dsc": result.best_validation_dsc,
        "late_weights": "none",
        "init": "shared_random",
        "start": weights_digest(initial_network(RECIPE, 0).state_dict()),
        "start_source": "random weights of seed 0",
    }
    assert [path.name for path in tmp_path.iterdir()] == ["model.pt"]


def test_the_same_seed_gives_the_same_weights_and_others_do_not(tmp_path) -> None:
    first = weights(trained(tmp_path / "a"))
    torch.manual_seed(123)
    assert same(first, weights(trained(tmp_path / "b")))
    assert not same(first, weights(trained(tmp_path / "c", seed=1)))
    assert not same(first, weights(trained(tmp_path / "d", fold=1)))


def test_in_bfloat16_a_training_is_another_that_gives_the_same_each_time(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": True})
    mixed = settings(2, precision="bf16-mixed")
    first = weights(trained(tmp_path / "a", trainer=mixed))
    assert same(first, weights(trained(tmp_path / "b", trainer=mixed)))
    assert {value.dtype for value in first.values() if value.is_floating_point()} == {torch.float32}
    full = weights(trained(tmp_path / "c"))
    assert not same(first, full)
    assert all(torch.allclose(first[name], full[name], atol=0.1) for name in first)


@pytest.mark.parametrize("own", [1, 2])
def test_the_weights_do_not_depend_on_the_threads_in_force_around_a_training(tmp_path, own: int) -> None:
    budget = settings(1, threads=own)
    before = torch.get_num_threads()
    found = []
    try:
        for threads in (1, 2, 3):
            torch.set_num_threads(threads)
            found.append(weights(trained(tmp_path / str(threads), trainer=budget, model=WIDE)))
            assert torch.get_num_threads() == threads
    finally:
        torch.set_num_threads(before)
    assert same(found[0], found[1]) and same(found[0], found[2])


def test_two_processes_at_the_same_time_give_the_weights_of_one(tmp_path) -> None:
    alone = trained(tmp_path / "alone", epochs=1, model=WIDE)
    folders = [tmp_path / str(threads) for threads in (1, 2)]
    code = "import sys; from pathlib import Path; import test_fold as t; "
    code += "t.trained(Path(sys.argv[1]), epochs=1, model=t.WIDE)"
    places = os.pathsep.join((str(Path(__file__).parent), *sys.path))
    running = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(folder)],
            env={**os.environ, "PYTHONPATH": places, "OMP_NUM_THREADS": folder.name},
        )
        for folder in folders
    ]
    assert [process.wait() for process in running] == [0, 0]
    for folder in folders:
        assert same(weights(alone), dict(Checkpoint.load(folder / "model.pt").weights))


def test_every_fold_starts_from_the_weights_of_the_file(tmp_path) -> None:
    start = trained(tmp_path / "start")
    still = settings(1, learning_rate=1e-12, weight_decay=0.0)
    init = Pretrained(start.checkpoint, allow_seen_data=True)
    for fold in (0, 1):
        result = trained(tmp_path / str(fold), trainer=still, fold=fold, initialisation=init)
        moved = weights(result)
        for name, tensor in weights(start).items():
            if "running" not in name and "num_batches" not in name:
                torch.testing.assert_close(moved[name], tensor, atol=1e-9, rtol=0)
        notes = Checkpoint.load(result.checkpoint).notes
        assert notes["init"] == "pretrained" and notes["start_source"] == "weights trained on unknown data"
        assert notes["start"] == weights_digest(weights(start))


def test_training_leaves_torch_as_it_was(tmp_path) -> None:
    torch.manual_seed(7)
    expected = torch.rand(2)
    torch.manual_seed(7)
    trained(tmp_path, epochs=1)
    assert torch.equal(torch.rand(2), expected)
    assert not torch.are_deterministic_algorithms_enabled()


def test_seed_zero_seeds_and_first_weights_depend_on_the_seed_alone() -> None:
    torch.manual_seed(1)
    first = initial_network(RECIPE, 0).state_dict()
    torch.manual_seed(2)
    assert same(first, initial_network(RECIPE, 0).state_dict())
    assert not same(first, initial_network(RECIPE, 1).state_dict())


def test_training_stops_when_validation_no_longer_improves(tmp_path) -> None:
    result = trained(
        tmp_path, trainer=settings(30, batch_size=8, learning_rate=1e-9, patience=2, warmup_epochs=0)
    )
    assert len(result.history) < 30
    assert len(result.history) == result.best_epoch + 1 + 2


def test_every_epoch_reports_its_measures(tmp_path) -> None:
    result = trained(tmp_path, epochs=2)
    for report in result.history:
        assert set(report) == {"learning_rate", "train_loss", "validation_loss", "validation_dsc", *MEASURED}
        assert report["images_per_s"] > 0 and report["peak_memory_mb"] > 0


def test_a_training_that_diverges_is_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(DiceCrossEntropy, "__call__", lambda self, logits, masks: logits.mean() * torch.nan)
    with pytest.raises(RuntimeError, match="expected a finite validation loss, received nan after 1 epochs"):
        trained(tmp_path)


class InterruptionError(Exception):
    """Stands for whatever stops a training."""


def interrupt_after(epochs: int):
    """An ``on_epoch`` that raises at the end of that epoch."""
    left = iter(range(epochs - 1))

    def interrupt(report: object) -> None:
        if next(left, None) is None:
            raise InterruptionError

    return interrupt


def comparable(result: TrainedFold) -> list[dict[str, float]]:
    """The history without what no two runs have alike."""
    return [
        {name: value for name, value in epoch.items() if name not in MEASURED} for epoch in result.history
    ]


@pytest.mark.parametrize("schedule", ["cosine", "one_cycle"])
def test_an_interrupted_training_is_resumed_to_the_same_result(tmp_path, schedule: str) -> None:
    budget = settings(5, schedule=schedule, learning_rate=0.02)
    whole = trained(tmp_path / "whole", trainer=budget)
    state = tmp_path / "state"
    with pytest.raises(InterruptionError):
        trained(tmp_path / "x", trainer=budget, state=state, on_epoch=interrupt_after(3))
    done = torch.load(state / "state.pt", weights_only=True)["history"]
    assert 1 <= len(done) <= 3
    torch.rand(7)  # what else the process draws doesn't matter
    reports: list[dict[str, float]] = []
    resume = dataclasses.replace(budget, resume=True)
    resumed = trained(tmp_path / "resumed", trainer=resume, state=state, on_epoch=reports.append)
    # The first epochs are those of the interrupted run, down to how fast they were: they were not trained again.
    assert list(resumed.history[: len(done)]) == list(done) and reports == list(resumed.history)
    assert comparable(resumed) == comparable(whole)
    assert resumed.best_epoch == whole.best_epoch
    assert same(weights(resumed), weights(whole))
    # Not the best epoch's weights alone: the last state is the same as well.
    trained(tmp_path / "again", trainer=budget, state=tmp_path / "other")
    last, expected = (
        torch.load(folder / "state.pt", weights_only=True) for folder in (state, tmp_path / "other")
    )
    assert same(last["weights"], expected["weights"])
    for moments, others in zip(
        last["optimiser"]["state"].values(), expected["optimiser"]["state"].values(), strict=True
    ):
        assert same(moments, others)


@pytest.mark.parametrize(("late", "selection"), [("ema", "smoothed"), ("swa", "last")])
def test_averaged_weights_are_resumed_to_the_same_result(tmp_path, late: str, selection: str) -> None:
    budget = settings(4, late_weights=late, selection=selection, selection_epochs=2, swa_share=0.8)
    whole = trained(tmp_path / "whole", trainer=budget)
    with pytest.raises(InterruptionError):
        trained(tmp_path / "x", trainer=budget, state=tmp_path / "s", on_epoch=interrupt_after(2))
    resume = dataclasses.replace(budget, resume=True)
    resumed = trained(tmp_path / "resumed", trainer=resume, state=tmp_path / "s")
    assert comparable(resumed) == comparable(whole) and same(weights(resumed), weights(whole))
    if selection == "last":
        assert whole.best_epoch == 3


def test_what_is_kept_is_what_was_validated(tmp_path) -> None:
    plain = trained(tmp_path / "plain", trainer=settings(4, selection="last"))
    averaged = trained(tmp_path / "ema", trainer=settings(4, selection="last", late_weights="ema"))
    for result in (plain, averaged):
        module = Segmenter(
            Checkpoint.load(result.checkpoint).network(), DiceCrossEntropy(), settings(4), lambda step: 1.0
        )
        images, masks = prepared(VALIDATION, Preprocessing(32)).tensors
        with torch.inference_mode():
            for first in range(0, len(images), 4):
                batch = [
                    Preprocessing(32).normalise(images[first : first + 4]),
                    masks[first : first + 4].float(),
                ]
                module.validation_step(batch, 0)
        dsc = module.take_measures()["validation_dsc"]
        assert dsc == pytest.approx(result.history[-1]["validation_dsc"], abs=1e-4)
    # The same steps were made: only what was validated differs.
    assert [one["train_loss"] for one in plain.history] == [one["train_loss"] for one in averaged.history]
    assert not same(weights(plain), weights(averaged))


def test_a_training_can_be_interrupted_again_and_again(tmp_path) -> None:
    budget = settings(4)
    resume = dataclasses.replace(budget, resume=True)
    whole = trained(tmp_path / "whole", trainer=budget)
    for epochs in (1, 2, 3):
        with pytest.raises(InterruptionError):
            trained(tmp_path / "x", trainer=resume, state=tmp_path / "s", on_epoch=interrupt_after(epochs))
    resumed = trained(tmp_path / "resumed", trainer=resume, state=tmp_path / "s")
    assert comparable(resumed) == comparable(whole) and same(weights(resumed), weights(whole))


def test_without_resume_a_training_begins_anew_and_a_finished_one_is_taken_as_it_is(tmp_path) -> None:
    first = trained(tmp_path / "a", state=tmp_path / "state")
    resume = settings(2, resume=True)
    taken = trained(tmp_path / "b", trainer=resume, state=tmp_path / "state")
    assert taken.history == first.history and same(weights(taken), weights(first))
    anew = trained(tmp_path / "c", state=tmp_path / "state")
    assert anew.history != first.history and comparable(anew) == comparable(first)
    names = {path.name for path in (tmp_path / "state").iterdir()}
    assert names == {"state.pt", f"model-{anew.best_epoch}.pt", ".lock"}


def test_a_finished_training_is_extended_and_by_more_later(tmp_path) -> None:
    state = tmp_path / "state"
    two, four = (settings(2, patience=9, extend_epochs=epochs) for epochs in (2, 4))
    base = trained(tmp_path / "base", trainer=settings(2, patience=9), state=state)
    extended = trained(tmp_path / "two", trainer=two, state=state)
    assert len(extended.history) == 4 and list(extended.history[:2]) == list(base.history)
    assert [epoch["learning_rate"] for epoch in extended.history[2:]] == [0.001, 0.001]
    longer = trained(tmp_path / "four", trainer=four, state=state)
    further = trained(tmp_path / "go-on", trainer=two, state=state)
    with pytest.raises(InterruptionError):
        trained(tmp_path / "x", trainer=four, state=state, on_epoch=interrupt_after(5))
    resumed = trained(tmp_path / "resumed", trainer=dataclasses.replace(four, resume=True), state=state)
    assert len(longer.history) == 6 and comparable(longer)[:4] == comparable(extended) == comparable(further)
    assert comparable(resumed) == comparable(longer) and same(weights(resumed), weights(longer))
    # What it began from is still there.
    again = trained(tmp_path / "again", trainer=settings(2, patience=9, resume=True), state=state)
    assert again.history == base.history and same(weights(again), weights(base))


def test_an_extension_without_a_better_epoch_keeps_the_weights_there_were(tmp_path, monkeypatch) -> None:
    state, budget = tmp_path / "state", settings(3, patience=3)
    base = trained(tmp_path / "base", trainer=budget, state=state)
    monkeypatch.setattr("models.training.phase.EXTENSION_FACTOR", 1e3)  # ruins the network
    worse = trained(tmp_path / "worse", trainer=dataclasses.replace(budget, extend_epochs=1), state=state)
    assert worse.best_epoch == base.best_epoch and len(worse.history) == 4
    assert same(weights(worse), weights(base))


def test_a_stop_by_the_keyboard_stays_one_and_leaves_the_signals_alone(tmp_path) -> None:
    def stop(report: object) -> None:
        raise KeyboardInterrupt

    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path, on_epoch=stop)
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == handlers


def test_refuses_to_extend_what_is_not_finished(tmp_path) -> None:
    state, extend = tmp_path / "state", settings(3, extend_epochs=2)
    with pytest.raises(InputError, match=r"extend_epochs: expected a finished .* received one with 0 of 3"):
        trained(tmp_path, trainer=extend, state=state)
    with pytest.raises(InterruptionError):
        trained(tmp_path, trainer=settings(3), state=state, on_epoch=interrupt_after(1))
    with pytest.raises(InputError, match=r"extend_epochs: expected a finished .* received one with 1 of 3"):
        trained(tmp_path, trainer=extend, state=state)


def test_refuses_the_state_of_another_training(tmp_path) -> None:
    trained(tmp_path, state=tmp_path / "state")
    resume = settings(2, resume=True)
    with pytest.raises(
        InputError, match=r"state\.pt: expected the state of this very training .* another seed"
    ):
        trained(tmp_path, trainer=resume, seed=1, state=tmp_path / "state")
    with pytest.raises(InputError, match=r"state_directory: expected the folder .* received none"):
        trained(tmp_path, trainer=resume)


def stop_at_second(epochs: list[object]):
    def stop(report: object) -> None:
        epochs.append(report)
        if len(epochs) == 2:
            raise KeyboardInterrupt

    return stop


@pytest.mark.parametrize("other_ends", ["finished", "killed"])
def test_takes_over_what_another_process_at_the_same_training_leaves(tmp_path, other_ends) -> None:
    alone, state, epochs = trained(tmp_path / "alone", epochs=3), tmp_path / "state", []
    if other_ends == "killed":
        with pytest.raises(KeyboardInterrupt):
            trained(tmp_path / "first", epochs=3, state=state, on_epoch=stop_at_second([]))
    else:
        first = trained(tmp_path / "first", epochs=3, state=state)
    other = FileLock(state / ".lock")
    other.acquire()
    second = trained(
        tmp_path / "second", epochs=3, state=state, on_wait=other.release, on_epoch=epochs.append
    )
    assert not other.is_locked
    assert len(epochs) == len(second.history) == 3
    assert same(weights(second), weights(alone))
    if other_ends == "finished":
        assert second.history == first.history  # with their speeds: nothing was trained again


def test_trains_again_where_nobody_else_is_at_work(tmp_path) -> None:
    first = trained(tmp_path / "first", state=tmp_path / "state")
    assert trained(tmp_path / "second", state=tmp_path / "state").history != first.history
