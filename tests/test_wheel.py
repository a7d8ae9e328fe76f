"""The wheel: it carries the configurations and works outside the checkout."""

from __future__ import annotations

import json
import os
import site
import subprocess
import sys
import venv
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest


def run(*words: object, folder: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(word) for word in words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    built = run(
        sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, repository,
        folder=folder, environment=dict(os.environ),
    )  # fmt: skip
    assert built.returncode == 0, built.stdout + built.stderr
    (path,) = folder.glob("*.whl")
    return path


def test_every_configuration_is_in_the_wheel(wheel: Path, repository: Path) -> None:
    inside = set(zipfile.ZipFile(wheel).namelist())
    expected = {
        f"experiments/conf/{path.relative_to(repository / 'conf')}"
        for path in repository.glob("conf/**/*.yaml")
    }
    assert expected
    assert expected <= inside
    modules = {str(path.relative_to(repository / "src")) for path in (repository / "src").rglob("*.py")}
    assert modules <= inside


@dataclass(frozen=True)
class Installed:
    """An environment with the wheel in it, and a folder to work in with a tracking store."""

    binaries: Path
    work: Path
    environment: dict[str, str]


@pytest.fixture
def installed(wheel: Path, tmp_path: Path, store_template: Path) -> Installed:
    place = tmp_path / "environment"
    venv.create(place, with_pip=False)
    (packages,) = (place / "lib").glob("python*/site-packages")
    # The dependencies are borrowed. A path file of theirs is not read, so the checkout's own install is not seen.
    (packages / "borrowed.pth").write_text("\n".join(site.getsitepackages()) + "\n")
    python = place / "bin" / "python"
    environment = {"PATH": f"{place / 'bin'}:/usr/bin:/bin", "HOME": str(tmp_path)}
    ended = run(
        sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", wheel,
        folder=tmp_path, environment=dict(os.environ),
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    work = tmp_path / "work"
    (work / "mlruns").mkdir(parents=True)
    (work / "mlruns" / "ctus.db").write_bytes((store_template / "ctus.db").read_bytes())
    return Installed(place / "bin", work, environment)


def test_the_installed_wheel_registers_a_users_files(installed: Installed) -> None:
    work, environment = installed.work, installed.environment
    python, ctus = installed.binaries / "python", installed.binaries / "ctus"
    # Many a user has a package of this name where the command is started.
    (work / "models").mkdir()
    (work / "models" / "__init__.py").write_text("MINE = True\n")

    where = run(
        python, "-c", "import experiments; print(experiments.__file__)", folder=work, environment=environment
    )
    assert str(installed.binaries.parent) in where.stdout, where.stderr
    both = run(
        python, "-c", "import models, ctus.models.metrics as m; print(models.MINE, m.hd95_mm.__module__)",
        folder=work, environment=environment,
    )  # fmt: skip
    assert both.stdout.split()[0] == "True", both.stderr
    assert both.stdout.split()[1].startswith("ctus.models."), both.stdout
    page = run(ctus, "--help", folder=work, environment=environment)
    assert "register" in page.stdout, page.stderr

    rng = np.random.default_rng(0)
    moving = rng.uniform(-1, 1, (400, 3)) * [40.0, 12.0, 5.0]
    fixed = moving @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]).T + [5.0, -3.0, 2.0]
    np.savetxt(work / "moving.xyz", moving)
    np.savetxt(work / "fixed.xyz", fixed)
    ended = run(
        ctus, "study=register", "moving=moving.xyz", "fixed=fixed.xyz", "out=result",
        folder=work, environment=environment,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr
    answer = json.loads((work / "result" / "registration.json").read_text())
    np.testing.assert_allclose(np.array(answer["fixed_T_moving"])[:3, 3], [5.0, -3.0, 2.0], atol=0.05)
    assert (work / "mlruns" / "artifacts").is_dir()


@pytest.mark.services
def test_the_installed_wheel_runs_the_demonstration(installed: Installed) -> None:
    """Minutes, for which it is not among the tests that run every time."""
    ended = run(
        installed.binaries / "ctus", "demo", "shown", folder=installed.work, environment=installed.environment
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert (installed.work / "shown" / "pipeline" / "scene.html").is_file()
    assert "Registration, simulated sweep" in ended.stdout
