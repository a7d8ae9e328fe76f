from itertools import pairwise

import pytest
import torch

from models.errors import InputError
from models.training.settings import TrainerSettings

GOOD = {"max_epochs": 10, "batch_size": 4, "learning_rate": 1e-3, "patience": 3}


def test_learning_rate_rises_then_follows_half_a_cosine_to_zero() -> None:
    settings = TrainerSettings(**GOOD, warmup_epochs=2)
    factors = [settings.learning_rate_factor(step, steps_per_epoch=5) for step in range(51)]
    assert factors[:10] == pytest.approx([(step + 1) / 11 for step in range(10)])
    assert factors[10] == 1.0
    assert factors[30] == pytest.approx(0.5)  # half-way between the end of the rise and the end
    assert factors[50] == pytest.approx(0.0, abs=1e-12)
    assert all(a > b for a, b in pairwise(factors[10:]))


def test_no_warm_up_starts_at_the_top_and_nothing_comes_after_the_end() -> None:
    settings = TrainerSettings(**GOOD, warmup_epochs=0)
    assert settings.learning_rate_factor(0, 5) == 1.0
    assert settings.learning_rate_factor(500, 5) == 0.0


@pytest.mark.parametrize("warmup", [None, 2])
def test_one_cycle_is_that_of_torch(warmup: int | None) -> None:
    settings = TrainerSettings(**GOOD, schedule="one_cycle", warmup_epochs=warmup)
    optimiser = torch.optim.SGD([torch.nn.Parameter(torch.zeros(1))], lr=1.0)
    share = 0.3 if warmup is None else warmup / GOOD["max_epochs"]
    reference = torch.optim.lr_scheduler.OneCycleLR(optimiser, max_lr=1.0, total_steps=50, pct_start=share)
    for step in range(50):
        assert settings.learning_rate_factor(step, 5) == pytest.approx(optimiser.param_groups[0]["lr"])
        optimiser.step()
        if step < 49:
            reference.step()


def test_a_cosine_warms_up_for_one_epoch_where_nothing_is_said() -> None:
    said = TrainerSettings(**GOOD, warmup_epochs=1)
    unsaid = TrainerSettings(**GOOD)
    for step in range(50):
        assert said.learning_rate_factor(step, 5) == unsaid.learning_rate_factor(step, 5)


def test_float16_is_refused_on_a_cpu() -> None:
    with pytest.raises(
        InputError, match=r"precision: expected 32-true or bf16-mixed on a CPU, .* received '16-mixed'"
    ):
        TrainerSettings(**GOOD, precision="16-mixed")
    assert TrainerSettings(**GOOD, precision="16-mixed", accelerator="auto").precision == "16-mixed"
    assert TrainerSettings(**GOOD, precision="bf16-mixed").precision == "bf16-mixed"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("max_epochs", 0),
        ("batch_size", 0),
        ("patience", 0),
        ("learning_rate", 0.0),
        ("learning_rate", float("inf")),
        ("gradient_clip", -1.0),
        ("warmup_epochs", -1),
        ("weight_decay", -0.1),
        ("accelerator", "tpu"),
        ("precision", "64-true"),
        ("schedule", "step"),
        ("extend_epochs", -1),
        ("threads", 0),
        ("selection", "worst"),
        ("selection_epochs", 0),
        ("late_weights", "polyak"),
        ("ema_epochs", 0.0),
        ("swa_share", 0.0),
        ("swa_share", 1.5),
        ("empty_weight", -1.0),
        ("empty_weight", float("inf")),
    ],
)
def test_refuses_settings_by_name(field: str, value: object) -> None:
    with pytest.raises(InputError, match=rf"^{field}: expected .* received {value!r}$"):
        TrainerSettings(**{**GOOD, field: value})


@pytest.mark.parametrize("field", ["resume", "deterministic"])
def test_yes_and_no_are_no_truth_values(field: str) -> None:
    settings = TrainerSettings(**GOOD)
    object.__setattr__(settings, field, "no")  # as a configuration would give it, where types aren't checked
    with pytest.raises(InputError, match=f"{field}: expected true or false, received 'no'"):
        settings.__post_init__()
