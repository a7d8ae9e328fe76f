import pytest
import torch

from models.averaging import Member, Weights, greedy_average, uniform_average
from models.errors import InputError
from models.networks.unet import UNet

RECIPE = UNet(width=2, depth=2)


def members(*values: float) -> list[Member]:
    return [
        Member(f"fold {index}", RECIPE, {"a": torch.tensor([float(value)])}, "start")
        for index, value in enumerate(values)
    ]


def near_four(weights: Weights) -> float:
    return -abs(float(weights["a"]) - 4.0)


def test_a_uniform_average_by_hand() -> None:
    assert uniform_average(members(1, 2, 6))["a"].tolist() == [3.0]


def test_the_average_of_equal_weights_is_those_weights() -> None:
    torch.manual_seed(0)
    network = UNet(width=4, depth=3)()
    same = [Member(str(i), RECIPE, network.state_dict(), "s") for i in range(3)]
    average = uniform_average(same)
    assert all(torch.equal(average[name], tensor) for name, tensor in network.state_dict().items())


def test_greedy_leaves_out_what_lowers_the_score_and_tries_the_next() -> None:
    # Alone: -3, -1, -2 (6), -10. With 3: (3 + 6) / 2 = 4.5 is better; then 1 gives 10 / 3, 14 gives 23 / 3: worse.
    found = greedy_average(members(1, 3, 6, 14), near_four)
    assert found.members == ("fold 1", "fold 2")
    assert found.weights["a"].tolist() == [4.5] and found.score == pytest.approx(-0.5)
    assert found.member_scores == (-3.0, -1.0, -2.0, -10.0)


def test_greedy_adds_where_the_score_stays_and_continues_after_a_refusal() -> None:
    # 5, then 3 (same score, average 4), then 20 (worse), then 4.0 would come first: it is best alone.
    found = greedy_average(members(5, 3, 20, 4), near_four)
    assert found.members == ("fold 3",)  # 4.5 is worse than 4, and so is 3.5
    tied = greedy_average(members(5, 20, 5), near_four)
    assert tied.members == ("fold 0", "fold 2")


def test_greedy_is_never_worse_than_the_best_member() -> None:
    generator = torch.Generator().manual_seed(0)
    for _ in range(20):
        values = (8 * torch.rand(5, generator=generator)).tolist()
        found = greedy_average(members(*values), near_four)
        assert found.score >= max(found.member_scores)
        assert found.score == near_four(found.weights)


def test_only_averages_are_refreshed() -> None:
    refreshed: list[float] = []

    def refresh(weights: Weights) -> Weights:
        refreshed.append(float(weights["a"]))
        return {"a": weights["a"] * 0 + 4}

    found = greedy_average(members(1, 6), near_four, refresh=refresh)
    assert refreshed == [3.5] and found.weights["a"].tolist() == [4.0] and found.score == 0


def test_refuses_other_starts_and_undefined_scores() -> None:
    mixed = [*members(1.0), Member("other", RECIPE, {"a": torch.ones(1)}, "another start")]
    with pytest.raises(InputError, match="start of other"):
        uniform_average(mixed)
    with pytest.raises(InputError, match="start of other"):
        greedy_average(mixed, near_four)
    assert uniform_average(mixed, same_start=False)["a"].tolist() == [1.0]
    with pytest.raises(InputError, match="score of fold 0: expected a number, received NaN"):
        greedy_average(members(1, 2), lambda weights: float("nan"))
