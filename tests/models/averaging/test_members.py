import pytest
import torch

from models.averaging import Member, require_averageable, weights_digest
from models.averaging.members import combination
from models.errors import InputError
from models.networks.unet import UNet

RECIPE = UNet(width=2, depth=2)


def member(name: str, start: str | None = "s", **changes: torch.Tensor) -> Member:
    return Member(name, RECIPE, {"a": torch.ones(2), "n": torch.tensor(3), **changes}, start)


def test_a_digest_depends_on_values_names_shapes_and_types_alone() -> None:
    tensor = torch.arange(24.0).reshape(1, 2, 3, 4)
    strided = tensor.contiguous(memory_format=torch.channels_last)
    base = weights_digest({"a": tensor, "b": torch.tensor(1)})
    assert weights_digest({"b": torch.tensor(1), "a": strided}) == base
    others = [
        {"a": tensor + 1e-6, "b": torch.tensor(1)},
        {"a": tensor.reshape(2, 1, 3, 4), "b": torch.tensor(1)},
        {"a": tensor.double(), "b": torch.tensor(1)},
        {"a": tensor, "c": torch.tensor(1)},
    ]
    assert base not in {weights_digest(other) for other in others}
    assert weights_digest({"a": torch.ones(3, dtype=torch.bfloat16)})


def test_a_combination_weighs_floats_and_takes_the_largest_count() -> None:
    first = {"a": torch.tensor([1.0, 2.0]), "n": torch.tensor(3)}
    second = {"a": torch.tensor([3.0, -2.0]), "n": torch.tensor(5)}
    combined = combination([first, second], [0.25, 0.75])
    assert combined["a"].tolist() == [2.5, -1.0] and int(combined["n"]) == 5
    assert combined["a"].dtype == torch.float32 and combined["n"].dtype == torch.int64
    assert first["a"].tolist() == [1.0, 2.0]


def test_refuses_what_can_not_be_averaged() -> None:
    require_averageable([member("x"), member("y")])
    require_averageable([member("alone", None)])
    with pytest.raises(InputError, match="members: expected at least one"):
        require_averageable([])
    with pytest.raises(InputError, match=r"start of y: expected that of x \(s\), received t"):
        require_averageable([member("x"), member("y", "t")])
    with pytest.raises(InputError, match=r"start of x: expected the digest .* found none"):
        require_averageable([member("x", None), member("y", None)])
    require_averageable([member("x"), member("y", "t")], same_start=False)
    with pytest.raises(InputError, match="architecture of y: expected that of x"):
        require_averageable([member("x"), Member("y", UNet(width=4, depth=2), {}, "s")])


def test_refuses_unlike_tensors_and_numbers_that_are_not_finite() -> None:
    with pytest.raises(
        InputError, match=r"weights of y: expected a as in x, torch.float32 \(2,\), received .*\(3,\)"
    ):
        require_averageable([member("x"), member("y", a=torch.ones(3))])
    with pytest.raises(InputError, match=r"received torch\.float64"):
        require_averageable([member("x"), member("y", a=torch.ones(2).double())])
    with pytest.raises(InputError, match="expected b as in x, absent"):
        require_averageable([member("x"), member("y", b=torch.ones(2))])
    with pytest.raises(InputError, match="weights of y: expected finite numbers, found others in a"):
        require_averageable([member("x"), member("y", a=torch.tensor([1.0, float("inf")]))])
