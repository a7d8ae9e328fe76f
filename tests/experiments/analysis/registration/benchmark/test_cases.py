"""The benchmark's cases on disk: made once, resumed, and compared with the digests that are committed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from benchmark_cases import written_cases

from experiments.analysis.registration.benchmark import cases
from experiments.analysis.registration.benchmark.cases import (
    block_specs,
    differences,
    freeze,
    frozen_digests,
    make_cases,
)
from experiments.errors import InputError
from experiments.outcome import Silent
from registration.benchmark.blocks import SUBSETS, blocks_of, collection_name
from registration.benchmark.case_files import case_names, truth_file, written_digest

NAMES = {"tube_a": ("a", "whole"), "tube_b": ("b", "whole")}


def test_the_digest_of_every_case_is_committed() -> None:
    frozen = frozen_digests()
    blocks = {
        collection_name(*one): one for one in ((sub, block) for sub in SUBSETS for block in blocks_of(sub))
    }
    assert set(frozen) == set(blocks)
    for name, (subset, block) in blocks.items():
        assert list(frozen[name]) == [spec.name for spec in block_specs(subset, block)]
        assert all(len(digest) == 16 for digest in frozen[name].values())


def test_cases_are_made_once_and_the_same_by_one_worker_or_two(tmp_path: Path) -> None:
    wanted = [spec for spec in block_specs("development") if spec.kind == "piece40_middle"][:2]
    assert make_cases(tmp_path / "two", wanted, 2, Silent(), "development") == ()
    assert case_names(tmp_path / "two") == [spec.name for spec in wanted]
    first = tmp_path / "two" / wanted[0].name / "moving.ply"
    before = first.stat().st_mtime_ns
    # One that was lost is made again, the other is left as it is.
    truth_file(tmp_path / "two", wanted[1].name).unlink()
    for path in (tmp_path / "two" / wanted[1].name).iterdir():
        path.unlink()
    assert make_cases(tmp_path / "two", wanted, 1, Silent(), "development") == ()
    assert first.stat().st_mtime_ns == before
    assert written_digest(tmp_path / "two", wanted[1].name) == frozen_digests()["development"][wanted[1].name]


def test_a_case_of_another_block_is_the_frozen_one(tmp_path: Path) -> None:
    wanted = [spec for spec in block_specs("development", "deforming") if spec.kind.startswith("field")][1:2]
    assert make_cases(tmp_path, wanted, 1, Silent(), "development_deforming") == ()


def test_a_case_that_changed_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written_cases(tmp_path, NAMES)
    right = {name: written_digest(tmp_path, name) for name in NAMES}
    monkeypatch.setattr(cases, "frozen_digests", lambda: {"drawn": right})
    assert differences(tmp_path, list(NAMES), "drawn") == ()
    truth = truth_file(tmp_path, "tube_b")
    truth.write_text(json.dumps(json.loads(truth.read_text()) | {"digest": "0" * 16}))
    (told,) = differences(tmp_path, list(NAMES), "drawn")
    assert told.startswith(f"1 of 2 drawn cases in {tmp_path} are not the frozen ones (first: tube_b)")
    assert "not comparable" in told


def test_freezing_writes_the_digests_of_all_cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "frozen_file", lambda: tmp_path / "rigid.json")
    folder = tmp_path / "symmetric"
    names = {spec.name: (spec.anatomy, spec.kind) for spec in block_specs("symmetric")}
    written_cases(folder, names)
    assert freeze({("symmetric", "undeformed"): folder}) == len(names)
    assert frozen_digests() == {"symmetric": {name: written_digest(folder, name) for name in names}}
    truth_file(folder, "cone_whole").unlink()
    with pytest.raises(InputError, match="expected all cases of symmetric, received none of cone_whole"):
        freeze({("symmetric", "undeformed"): folder})


def test_a_subset_that_there_is_not_is_refused() -> None:
    with pytest.raises(
        InputError, match="subset: expected one of development, test, symmetric, received 'all'"
    ):
        block_specs("all")
    with pytest.raises(InputError, match="blocks: expected some of undeformed, deforming"):
        block_specs("test", "soft")
