import pytest
import torch

from models.errors import InputError
from models.processor import fixed_threads, has_bfloat16_units


def test_the_number_of_threads_is_fixed_and_restored_also_after_an_error() -> None:
    before = torch.get_num_threads()
    with pytest.raises(KeyError), fixed_threads(before + 2):
        assert torch.get_num_threads() == before + 2
        raise KeyError
    assert torch.get_num_threads() == before


def test_less_than_one_thread_is_refused() -> None:
    with pytest.raises(InputError, match="threads: expected at least 1, received 0"), fixed_threads(0):
        raise AssertionError("entered")


@pytest.mark.parametrize(
    ("found", "expected"), [({"amx_bf16": True}, True), ({"amx_bf16": False}, False), ({"neon": True}, False)]
)
def test_units_for_bfloat16_are_those_of_the_processor(
    monkeypatch, found: dict[str, bool], expected: bool
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: found)
    assert has_bfloat16_units() is expected
