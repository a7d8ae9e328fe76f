from types import SimpleNamespace

import pytest
import torch

from models.training import throughput
from models.training.throughput import Throughput, peak_memory_mb


def test_only_the_time_from_first_fetch_to_last_batch_counts(monkeypatch) -> None:
    now_s = [0.0]
    monkeypatch.setattr(throughput.time, "perf_counter", lambda: now_s[0])
    meter = Throughput(torch.device("cpu"))
    for validation_s in (100.0, 7.0):
        meter.start()
        for batch, last in ((8, False), (8, False), (4, True)):
            now_s[0] += 0.5
            meter.count(batch, last)
        now_s[0] += validation_s
        assert meter.images_per_s == pytest.approx(20 / 1.5)


@pytest.mark.parametrize(("platform", "expected_mb"), [("linux", 2048.0), ("darwin", 2.0)])
def test_peak_memory_is_in_a_million_bytes(monkeypatch, platform: str, expected_mb: float) -> None:
    assert 50 < peak_memory_mb(torch.device("cpu")) < 1e6
    monkeypatch.setattr(throughput.sys, "platform", platform)
    monkeypatch.setattr(throughput.resource, "getrusage", lambda who: SimpleNamespace(ru_maxrss=2_000_000))
    assert peak_memory_mb(torch.device("cpu")) == expected_mb
