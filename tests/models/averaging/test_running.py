import pytest
import torch
from torch import Tensor

from models.averaging import ExponentialAverage, StochasticAverage
from models.errors import InputError


def weights(value: float, count: int = 0) -> dict[str, Tensor]:
    return {"a": torch.tensor([value, -value]), "n": torch.tensor(count)}


def test_a_stochastic_average_is_the_mean_of_its_updates() -> None:
    average = StochasticAverage()
    for count, value in enumerate((1.0, 2.0, 6.0)):
        average.update(weights(value, count))
    torch.testing.assert_close(average.weights["a"], torch.tensor([3.0, -3.0]))
    assert int(average.weights["n"]) == 2 and average.updates == 3


def test_an_exponential_average_by_hand() -> None:
    average = ExponentialAverage(decay=0.15)
    average.update(weights(1.0))
    assert average.weights["a"].tolist() == [1.0, -1.0]
    # The second decay would be 2 / 11, above 0.15.
    average.update(weights(2.0))
    assert float(average.weights["a"][0]) == pytest.approx(0.15 * 1 + 0.85 * 2)


def test_the_first_weights_are_soon_forgotten_whatever_the_decay() -> None:
    average = ExponentialAverage(decay=0.9999)
    average.update(weights(1000.0))
    for _ in range(50):
        average.update(weights(1.0))
    assert float(average.weights["a"][0]) == pytest.approx(1.0, abs=1e-3)


def test_the_decay_is_reached() -> None:
    average = ExponentialAverage(decay=0.9)
    assert average.newest_share(1000) == pytest.approx(0.1)
    assert [average.newest_share(update) for update in (1, 2)] == pytest.approx([0.9, 9 / 11])


def test_there_is_no_average_before_the_first_update() -> None:
    for average in (ExponentialAverage(), StochasticAverage()):
        with pytest.raises(InputError, match="expected an update after a step of the training"):
            _ = average.weights


def test_an_average_keeps_its_own_copy_and_the_types() -> None:
    average, given = StochasticAverage(), {"a": torch.ones(2, dtype=torch.bfloat16)}
    average.update(given)
    given["a"].zero_()
    average.weights["a"].zero_()
    assert average.weights["a"].tolist() == [1.0, 1.0] and average.weights["a"].dtype == torch.bfloat16
    # In 16 bits 1 + 1/256 is 1: the mean is held in 32.
    for _ in range(3):
        average.update({"a": torch.full((2,), 1 + 2**-7, dtype=torch.bfloat16)})
    assert float(average.state()["average"]["a"][0]) == pytest.approx(1 + 0.75 * 2**-7)


@pytest.mark.parametrize("kind", [ExponentialAverage, StochasticAverage])
def test_an_interrupted_average_continues_as_if_it_never_was(
    kind: type[ExponentialAverage] | type[StochasticAverage],
) -> None:
    whole, before, after = kind(), kind(), kind()
    values = [float(value) for value in torch.rand(6, generator=torch.Generator().manual_seed(0))]
    for value in values:
        whole.update(weights(value))
    for value in values[:3]:
        before.update(weights(value))
    after.restore(before.state())
    for value in values[3:]:
        after.update(weights(value))
    assert torch.equal(whole.weights["a"], after.weights["a"]) and after.updates == 6


def test_refuses_other_tensors_other_decays_and_broken_weights() -> None:
    average = ExponentialAverage()
    average.update(weights(1.0))
    with pytest.raises(InputError, match="weights: expected a to be"):
        average.update({"a": torch.ones(3), "n": torch.tensor(0)})
    with pytest.raises(InputError, match="weights: expected b to be"):
        average.update({**weights(1.0), "b": torch.ones(1)})
    average.update(weights(float("nan")))
    with pytest.raises(InputError, match="expected finite numbers, found others in a"):
        _ = average.weights
    for decay in (-0.1, 1.0, float("nan")):
        with pytest.raises(InputError, match="decay: expected 0 to below 1"):
            ExponentialAverage(decay)
