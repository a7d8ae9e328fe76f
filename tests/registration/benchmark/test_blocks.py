"""The blocks: which cases there are, under which names they are kept, and what is refused."""

from __future__ import annotations

from collections import Counter

import pytest

from registration.benchmark.blocks import BLOCKS, SUBSETS, blocks_of, collection_name, specs
from registration.errors import InputError

COUNTS = {"undeformed": 192, "deforming": 56, "wrong_vessel": 140, "overlap": 36, "noise": 24}


@pytest.mark.parametrize("block", BLOCKS)
def test_cases_have_names_of_their_own_and_test_anatomies_are_not_those_of_development(block: str) -> None:
    development, test = specs("development", block), specs("test", block)
    for found in (development, test):
        assert len(found) == COUNTS[block] == len({spec.name for spec in found})
        assert {spec.block for spec in found} == {block}
    assert {spec.kind for spec in development} == {spec.kind for spec in test}
    assert all(spec.seed < 1000 <= other.seed for spec, other in zip(development, test, strict=True))
    if block != "undeformed":
        assert not {spec.seed for spec in test} & {spec.seed for spec in specs("test")}


def test_every_motion_comes_in_every_size_and_on_designed_vessels() -> None:
    found = specs("test", "deforming")
    kinds = Counter(spec.kind for spec in found)
    assert set(kinds) == {
        f"{motion}_{size}"
        for motion in ("press", "bend", "indentation", "field")
        for size in ("small", "medium", "large")
    }
    assert min(kinds.values()) >= 4
    for name in ("artery", "vein"):
        motions = [spec.kind.split("_")[0] for spec in found if spec.anatomy == name]
        assert motions == ["press", "bend", "indentation", "field"]


def test_a_model_of_another_vessel_is_never_its_own() -> None:
    found = specs("test", "wrong_vessel")
    wrong = [spec for spec in found if not spec.kind.startswith("own")]
    assert len(wrong) == 100
    assert all((spec.model_seed is None) == spec.kind.startswith(("mirror", "own")) for spec in found)
    assert all(spec.model_seed != spec.seed for spec in wrong)
    assert all(spec.model_seed is None or spec.model_seed >= 1000 for spec in wrong)
    assert wrong[0].name == "random1100_other_whole_1101"


def test_blocks_are_kept_apart_and_the_undeformed_one_under_its_subset() -> None:
    names = [collection_name(subset, block) for subset in SUBSETS for block in blocks_of(subset)]
    assert len(names) == len(set(names)) == 11
    assert collection_name("test") == "test"
    assert collection_name("test", "noise") == "test_noise"
    assert blocks_of("symmetric") == ("undeformed",)


def test_what_there_is_not_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"blocks: expected some of undeformed, deforming, .* received 'soft'"
    ):
        specs("test", "soft")
    with pytest.raises(
        InputError, match="blocks: expected some of undeformed with symmetric, received 'noise'"
    ):
        specs("symmetric", "noise")
    with pytest.raises(InputError, match="subset: expected one of"):
        specs("training", "noise")
