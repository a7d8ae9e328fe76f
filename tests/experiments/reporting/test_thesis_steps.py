"""The steps that rebuild the thesis: every published value has one, and every step is a call that there is."""

from __future__ import annotations

import pytest

from experiments.reporting.published import published_values
from experiments.reporting.thesis_steps import Step, command_for, thesis_steps
from experiments.running.jobs import study_names


def test_every_published_value_has_a_command() -> None:
    for study, values in published_values().items():
        for value in values.values():
            assert command_for(study, tuple(value.dataset)).startswith("ctus "), study


def test_a_step_on_the_data_set_of_the_value_comes_first() -> None:
    assert "dataset=carotid" in command_for("segmentation", ("phantom", "carotid"))
    assert "dataset=usgra" in command_for("segmentation", ("usgra",))
    assert command_for("nothing") == ""


def test_steps_name_studies_that_there_are() -> None:
    assert {step.study for step in thesis_steps() if step.study} <= set(study_names())
    assert len({step.name for step in thesis_steps()}) == len(thesis_steps())


@pytest.mark.parametrize("step", thesis_steps(), ids=lambda step: step.name)
def test_places_are_filled_and_the_smoke_budget_replaces_words(step: Step) -> None:
    words = step.arguments("smoke", "/data", "/out")
    assert not any("{data}" in word or "{out}" in word or "{trainer}" in word for word in words)
    names = [word.partition("=")[0] for word in words]
    assert len(names) == len(set(names))
    assert "<folder" not in " ".join(words)


def test_a_word_of_the_smoke_budget_replaces_that_of_the_same_setting() -> None:
    step = Step(
        "one",
        "-m study=x dataset.root={data}/a trainer={trainer} split.folds=5",
        smoke="split.folds=2 sweeps=1",
    )
    assert step.arguments("cpu", "/d", "/o") == [
        "-m", "study=x", "dataset.root=/d/a", "trainer=cpu", "split.folds=5",
    ]  # fmt: skip
    assert step.arguments("smoke", "/d", "/o") == [
        "-m", "study=x", "dataset.root=/d/a", "trainer=smoke", "split.folds=2", "sweeps=1",
    ]  # fmt: skip
    assert step.command == ("ctus -m study=x dataset.root=<folder of data sets>/a trainer=cpu split.folds=5")
