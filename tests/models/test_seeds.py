import pytest

from models.errors import InputError
from models.seeds import seed_of


def test_seeds_of_purposes_differ() -> None:
    seeds = {seed_of(seed, purpose, fold) for seed in (0, 1) for purpose in (0, 1) for fold in (0, 1, 2)}
    assert len(seeds) == 12


def test_a_seed_is_always_the_same() -> None:
    assert seed_of(0, 1, 2) == seed_of(0, 1, 2)
    with pytest.raises(InputError, match="seed: expected a number from 0, received -1"):
        seed_of(-1)
