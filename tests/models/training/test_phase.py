import dataclasses

from models.training.phase import Phase
from models.training.settings import TrainerSettings

SETTINGS = TrainerSettings(max_epochs=6, batch_size=4, learning_rate=0.5, patience=2, extend_epochs=4)


def history(*dsc: float) -> list[dict[str, float]]:
    return [{"validation_dsc": value} for value in dsc]


def test_a_training_is_over_at_its_end_or_when_patience_is() -> None:
    phase = Phase.whole(SETTINGS)
    assert not phase.is_over(history())
    assert not phase.is_over(history(0.5, 0.4))
    assert phase.is_over(history(0.5, 0.4, 0.5))
    assert not phase.is_over(history(0.1, 0.2, 0.3, 0.4, 0.5))
    assert phase.is_over(history(0.1, 0.2, 0.3, 0.4, 0.5, 0.6))


def test_the_last_epoch_is_kept_though_patience_waits_for_the_best() -> None:
    phase = Phase.whole(dataclasses.replace(SETTINGS, selection="last"))
    assert phase.kept(history(0.1, 0.5, 0.4, 0.3)) == 3
    assert phase.is_over(history(0.1, 0.5, 0.4, 0.3)) and not phase.is_over(history(0.1, 0.5, 0.4))


def test_an_extension_has_patience_of_its_own() -> None:
    base = history(0.5, 0.4, 0.4)
    extension = Phase.whole(SETTINGS).extension(base)
    assert (extension.first, extension.end) == (3, 7)
    assert not extension.is_over(base)
    assert not extension.is_over([*base, *history(0.3)])
    assert extension.is_over([*base, *history(0.3, 0.3)])
    assert not extension.is_over([*base, *history(0.3, 0.6, 0.1)])
    assert extension.is_over([*base, *history(0.6, 0.7, 0.8, 0.9)])


def test_learning_rate_follows_the_schedule_then_stays_at_a_tenth_whatever_the_length() -> None:
    phase = Phase.whole(SETTINGS)
    assert [phase.learning_rate_factor(step, 2) for step in range(12)] == [
        SETTINGS.learning_rate_factor(step, 2) for step in range(12)
    ]
    for epochs in (1, 10):
        settings = dataclasses.replace(SETTINGS, extend_epochs=epochs)
        extension = Phase.whole(settings).extension(history(0.5, 0.4, 0.4))
        assert {extension.learning_rate_factor(step, 2) for step in range(6, 26)} == {0.1}
