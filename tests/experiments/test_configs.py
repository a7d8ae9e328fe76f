"""Every configuration file composes, and what it names can be built."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments import cells, registry
from experiments.cli import compose_points

CONF = Path(__file__).resolve().parents[2] / "conf"
STUDIES = sorted(path.stem for path in (CONF / "study").glob("*.yaml"))
OPTIONS = sorted(
    (path.parent.name, path.stem)
    for path in CONF.glob("*/*.yaml")
    if path.parent.name not in ("study", "preset")
)


def mandatory(study: str) -> list[str]:
    """A value for every setting of a study that the user must give."""
    lines = (CONF / "study" / f"{study}.yaml").read_text().splitlines()
    return [f"{line.split(':')[0]}=given" for line in lines if line.split("#")[0].rstrip().endswith(": ???")]


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
