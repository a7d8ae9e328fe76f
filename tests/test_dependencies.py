"""The pinned versions are those that pyproject.toml allows: nothing is pinned that was excluded on purpose."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


@pytest.fixture(scope="module")
def pins(repository: Path) -> dict[str, str]:
    lines = (repository / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pairs = (line.partition("==")[::2] for line in lines if line and not line.startswith("#"))
    return {canonicalize_name(name): version for name, version in pairs}


def requirements(repository: Path) -> list[Requirement]:
    project = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    return [
        Requirement(text)
        for text in (*project["dependencies"], *(each for extra in extras for each in extra))
    ]


def test_every_pin_is_a_version_that_is_allowed(repository: Path, pins: dict[str, str]) -> None:
    asked = {canonicalize_name(each.name): each for each in requirements(repository)}
    wrong = {
        name: (pins[name], str(each.specifier))
        for name, each in asked.items()
        if name in pins and not each.specifier.contains(pins[name], prereleases=True)
    }
    assert wrong == {}


@pytest.mark.parametrize("version", ["2.6.2", "2.6.3"])
def test_the_versions_of_lightning_that_an_intruder_published_are_never_installed(
    repository: Path, pins: dict[str, str], version: str
) -> None:
    lightning = next(each for each in requirements(repository) if each.name == "lightning")
    assert not lightning.specifier.contains(version)
    assert version not in (pins["lightning"], pins["pytorch-lightning"])


def test_what_the_server_and_the_audit_need_is_pinned(pins: dict[str, str]) -> None:
    assert {"psycopg2-binary", "flask-wtf", "pip-audit"} <= pins.keys()
