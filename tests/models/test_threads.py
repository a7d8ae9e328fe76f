import pytest
import torch

from models.errors import InputError
from models.threads import fixed_threads


def test_the_number_of_threads_is_fixed_and_restored_also_after_an_error() -> None:
    before = torch.get_num_threads()
    with pytest.raises(KeyError), fixed_threads(before + 2):
        assert torch.get_num_threads() == before + 2
        raise KeyError
    assert torch.get_num_threads() == before


def test_less_than_one_thread_is_refused() -> None:
    with pytest.raises(InputError, match="threads: expected at least 1, received 0"), fixed_threads(0):
        raise AssertionError("entered")
