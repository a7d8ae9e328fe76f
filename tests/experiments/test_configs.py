"""Every configuration file composes, and what it names can be built."""

from __future__ import annotations

import pytest
from configurations import CONF, OPTIONS, STUDIES, mandatory

from experiments import cells, registry
from experiments.cli import compose_points


@pytest.mark.parametrize("study", STUDIES)
def test_a_study_composes_and_its_parts_build(study: str) -> None:
    ((config, _),) = compose_points([f"study={study}", *mandatory(study)])
    for cell, _ in cells.cell_configs(config):
        assert cells.arguments(cell)


@pytest.mark.parametrize("group, option", OPTIONS)
def test_an_option_composes_and_builds_in_a_study_that_takes_it(group: str, option: str) -> None:
    takers = [study for study in STUDIES if f"/{group}:" in (CONF / "study" / f"{study}.yaml").read_text()]
    assert takers, f"no study takes the group {group}"
    ((config, _),) = compose_points([f"study={takers[0]}", f"{group}={option}", *mandatory(takers[0])])
    assert registry.build(config[group], group)


def test_a_configuration_file_stays_short() -> None:
    long = [str(path) for path in CONF.rglob("*.yaml") if len(path.read_text().splitlines()) > 45]
    assert not long
