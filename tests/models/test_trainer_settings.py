from itertools import pairwise

import pytest

from models.errors import InputError
from models.trainer_settings import TrainerSettings

GOOD = {"max_epochs": 10, "batch_size": 4, "image_size_px": 32, "learning_rate": 1e-3, "patience": 3}


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


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("max_epochs", 0),
        ("batch_size", 0),
        ("image_size_px", -1),
        ("patience", 0),
        ("learning_rate", 0.0),
        ("learning_rate", float("inf")),
        ("gradient_clip", -1.0),
        ("warmup_epochs", -1),
        ("weight_decay", -0.1),
        ("accelerator", "tpu"),
        ("precision", "64-true"),
    ],
)
def test_refuses_settings_by_name(field: str, value: object) -> None:
    with pytest.raises(InputError, match=rf"^{field}: expected .* received {value!r}$"):
        TrainerSettings(**{**GOOD, field: value})
