from pathlib import Path

import pytest
import torch
from filelock import FileLock, Timeout

from models.errors import InputError
from models.training.state import TrainingFolder, TrainingState

STATE = TrainingState(
    history=({"validation_dsc": 0.5}, {"validation_dsc": 0.4}),
    weights={"w": torch.ones(2)},
    optimiser={"state": {0: {"step": torch.tensor(2.0)}}, "param_groups": [{"lr": 0.1}]},
    scaler={},
    runtime_s=3.0,
)


def folder(path: Path, fingerprint: str = "this") -> TrainingFolder:
    return TrainingFolder(path, fingerprint)


def test_a_state_comes_back_from_a_file_that_can_run_no_code(tmp_path) -> None:
    assert folder(tmp_path).load() is None
    folder(tmp_path).save(STATE, 0)
    loaded = folder(tmp_path).load()
    assert loaded is not None and loaded.history == STATE.history and loaded.runtime_s == 3.0
    assert torch.equal(loaded.weights["w"], STATE.weights["w"])
    assert loaded.optimiser == STATE.optimiser and loaded.scaler == {}
    torch.load(tmp_path / "state.pt", weights_only=True)


def test_saving_keeps_the_best_weights_alone(tmp_path) -> None:
    for epoch in (0, 1, 2):
        folder(tmp_path).weights_path(epoch).write_bytes(b"weights")
    folder(tmp_path).extended.path.mkdir()
    folder(tmp_path).extended.weights_path(7).write_bytes(b"weights")
    folder(tmp_path).save(STATE, 0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["extended", "model-0.pt", "state.pt"]
    assert folder(tmp_path).extended.weights_path(7).is_file()
    folder(tmp_path).clear()
    assert [path.name for path in tmp_path.rglob("*")] == ["extended"]


def test_a_failed_write_leaves_the_state_there_was(tmp_path, monkeypatch) -> None:
    folder(tmp_path).save(STATE, 0)
    before = (tmp_path / "state.pt").read_bytes()

    def full(content: object, path: Path) -> None:
        path.write_bytes(b"half")
        raise OSError("no space left on device")

    monkeypatch.setattr(torch, "save", full)
    with pytest.raises(OSError, match="no space left"):
        folder(tmp_path).save(STATE, 0)
    assert [path.name for path in tmp_path.iterdir()] == ["state.pt"]
    assert (tmp_path / "state.pt").read_bytes() == before


def test_refuses_a_state_that_is_not_this_trainings(tmp_path) -> None:
    folder(tmp_path).save(STATE, 0)
    with pytest.raises(InputError, match=r"state of this very training .* received that of other settings"):
        folder(tmp_path, "other").load()
    torch.save({"format": "another"}, tmp_path / "state.pt")
    with pytest.raises(InputError, match="received a file of another kind or version"):
        folder(tmp_path).load()
    for content in (b"", b"damaged"):
        (tmp_path / "state.pt").write_bytes(content)
        with pytest.raises(InputError, match="received a file that is damaged or of another kind"):
            folder(tmp_path).load()


def test_a_truncated_state_is_refused(tmp_path) -> None:
    folder(tmp_path).save(STATE, 0)
    whole = (tmp_path / "state.pt").read_bytes()
    (tmp_path / "state.pt").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="received a file that is damaged"):
        folder(tmp_path).load()


def test_one_process_at_a_time(tmp_path) -> None:
    with folder(tmp_path / "new").locked() as waited:
        assert waited is False
        first = FileLock(tmp_path / "new" / ".lock")
        with pytest.raises(Timeout):
            first.acquire(timeout=0)
    first.acquire()
    with folder(tmp_path / "new").locked(first.release) as waited:
        assert waited is True
