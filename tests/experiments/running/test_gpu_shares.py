"""Each process gets a GPU of its own, by a number of GPUs that is only said."""

from __future__ import annotations

import pytest

from experiments.running import gpu_shares
from experiments.running.gpu_shares import VISIBLE, gpus_needed, next_gpus, visible_gpus


def test_job_k_gets_gpu_k_modulo_their_number_while_none_has_ended() -> None:
    running: list[str] = []
    for _ in range(7):
        gpu = next_gpus(("0", "1", "2"), running)
        assert gpu is not None
        running.append(gpu)
    assert running == ["0", "1", "2", "0", "1", "2", "0"]


def test_the_gpu_of_a_process_that_has_ended_is_next() -> None:
    assert next_gpus(("0", "1", "2"), ["0", "2"]) == "1"
    assert next_gpus(("0", "1"), ["0", "1", "0"]) == "1"


def test_where_there_is_no_choice_a_process_keeps_what_it_sees() -> None:
    assert next_gpus((), []) is None
    assert next_gpus(("GPU-5f",), ["GPU-5f"]) is None


def test_gpus_that_the_user_named_are_shared_out_and_all_of_the_machine_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(gpu_shares, "gpu_names", lambda: ["A", "A", "A"])
    monkeypatch.delenv(VISIBLE, raising=False)
    assert visible_gpus() == ("0", "1", "2")
    for named, found in (("2, 0", ("2", "0")), ("GPU-1a,GPU-2b", ("GPU-1a", "GPU-2b")), ("", ()), ("-1", ())):
        monkeypatch.setenv(VISIBLE, named)
        assert visible_gpus() == found


def test_a_training_on_two_devices_has_two_gpus_of_its_own() -> None:
    gpus = ("0", "1", "2", "3")
    assert next_gpus(gpus, [], 2) == "0,1"
    assert next_gpus(gpus, ["0", "1"], 2) == "2,3"
    assert next_gpus(gpus, ["1"], 2) == "0,2"
    assert next_gpus(gpus[:2], [], 2) is None
    assert [gpus_needed(config) for config in ({}, {"trainer": {"devices": 2}}, {"trainer": {}})] == [1, 2, 1]
