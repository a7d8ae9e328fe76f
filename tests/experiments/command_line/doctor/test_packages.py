"""Interpreter, packages and system libraries: what is missing is named with the line that installs it."""

from __future__ import annotations

import re
from importlib import metadata
from pathlib import Path

import pytest

from experiments.command_line.doctor import packages
from experiments.command_line.doctor.findings import State


@pytest.mark.parametrize(
    ("version", "state"),
    [((3, 10), State.MISSING), ((3, 11), State.OK), ((3, 13), State.OK), ((3, 14), State.NOTE)],
)
def test_an_interpreter_that_is_too_old_is_missing(version: tuple[int, int], state: State) -> None:
    assert packages.interpreter(version).state is state


def test_packages_are_compared_with_what_the_distribution_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ["numpy>=999", "no-such-package>=1; python_version >= '3'", "yaml; extra == 'other'", "pyyaml"]
    monkeypatch.setattr(metadata, "requires", lambda name: asked)
    monkeypatch.setattr(metadata, "version", {"ctus": "1.2", "numpy": "2.0", "pyyaml": "6.0"}.__getitem__)
    monkeypatch.setattr(packages, "_version", {"ctus": "1.2", "numpy": "2.0", "pyyaml": "6.0"}.get)
    found = packages.required_packages()
    assert [each.state for each in found] == [State.OK, State.MISSING]
    assert "numpy>=999 (2.0 is installed)" in found[1].text
    assert found[1].remedy.endswith("-m pip install 'numpy>=999' 'no-such-package>=1'")


def test_a_distribution_that_is_not_installed_is_missing() -> None:
    (found,) = packages.required_packages("no-such-distribution")
    assert found.state is State.MISSING
    assert found.remedy.endswith("-m pip install --editable .")


def test_an_extra_that_is_not_installed_is_a_note_with_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ["numpy", "no-such-package>=1; extra == 'fast'", "pyyaml; extra == 'text'"]
    monkeypatch.setattr(metadata, "requires", lambda name: asked)
    ready, lacking = packages.optional_packages({"fast": "speed", "text": "words"})
    assert (ready.state, ready.text) == (State.OK, "text")
    assert (lacking.state, lacking.subject) == (State.NOTE, "extra fast")
    assert lacking.remedy.endswith("-m pip install 'no-such-package>=1'")


def test_a_library_that_does_not_load_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages.platform, "system", lambda: "Linux")
    monkeypatch.setattr(packages.shutil, "which", lambda name: None)
    (found,) = packages.system_libraries({"libc.so.6": ("libc6", "glibc"), "libnone.so.9": ("none9", "none")})
    assert (found.state, found.text) == (State.MISSING, "libnone.so.9")
    assert found.remedy == "sudo apt-get install -y none9"


def test_a_package_that_does_not_load_is_named_with_what_the_system_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_package.py").write_text("import ctypes\nctypes.CDLL('libnone.so.9')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (found,) = packages.compiled_packages(("json", "broken_package", "no_such_package"))
    assert found.state is State.MISSING
    assert found.text.startswith("broken_package does not load: OSError: libnone.so.9")


def test_the_packages_that_are_installed_load() -> None:
    assert packages.compiled_packages() == []


def test_where_wheels_bring_their_libraries_none_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages.platform, "system", lambda: "Darwin")
    assert packages.system_libraries() == []


def test_set_up_installs_the_same_libraries(repository: Path) -> None:
    text = (repository / "scripts" / "setup.sh").read_text(encoding="utf-8")
    assert dict(re.findall(r"^need (lib\S+) (\S+)$", text, re.MULTILINE)) == {
        name: debian for name, (debian, _) in packages.LIBRARIES.items()
    }


def test_every_optional_extra_is_one_of_the_project(repository: Path) -> None:
    text = (repository / "pyproject.toml").read_text(encoding="utf-8")
    for extra in packages._OPTIONAL:
        assert re.search(rf"^{extra} = \[", text, re.MULTILINE), extra
