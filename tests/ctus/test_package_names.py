"""``ctus.models`` and the like: the same modules as by their plain names, also next to a ``models`` of the user's own.

Each case runs in a process of its own, because what a name means is decided by what was imported before.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SAME = """
import sys, ctus
assert not {'models', 'registration', 'numpy', 'torch'} & set(sys.modules), 'import ctus is instant'
assert set(dir(ctus)) >= {'models', 'registration', 'experiments'}
import ctus.registration.rigid.result as by_ctus
import registration.rigid.result as plain
assert by_ctus is plain
assert sys.modules['ctus.registration.rigid.result'] is plain
assert plain.__spec__.name == plain.__name__ == 'registration.rigid.result'
from ctus.registration.errors import InputError
import registration
assert ctus.registration is registration and ctus.registration.errors.InputError is InputError
from registration.rigid import MultiStartICP
from ctus.registration.rigid import MultiStartICP as Same
assert isinstance(MultiStartICP(), Same) and isinstance(Same(), MultiStartICP)
from ctus.models.value_types import mismatch
import models.value_types
assert models.value_types.mismatch is mismatch
import ctus.experiments.errors, experiments.errors
assert ctus.experiments.errors is experiments.errors
"""
OTHER_ORDER = """
import registration.errors
from ctus.registration.errors import InputError
assert InputError is registration.errors.InputError
"""
# In a folder that has models/__init__.py and models/mine.py.
BESIDE_ANOTHER = """
import sys
if {first}:
    import models.mine
from ctus.models.metrics import hd95_mm
from ctus.models.networks.unet import UNet
from ctus.models.networks.registry import recipes
import ctus.models.metrics.masks as masks
assert masks.__name__ == 'ctus.models.metrics.masks'
assert recipes()['unet'] is UNet
import models.mine
assert models.mine.WORD == 'mine' and not hasattr(models, 'metrics')
from ctus.registration.rigid import MultiStartICP
from registration.rigid import MultiStartICP as Plain
assert MultiStartICP is Plain, 'what is not hidden stays the same'
import numpy as np
a, b = np.zeros((9, 9), bool), np.zeros((9, 9), bool)
a[2, 2] = b[2, 5] = True
assert hd95_mm(a, b, (1.0, 1.0)) == 3.0
from ctus.experiments.statistics.intervals import wilson_interval
try:
    import ctus.experiments.cli
except ImportError as refusal:
    assert "found another 'models'" in str(refusal)
else:
    raise AssertionError('the command line would import the other models')
"""


def run(program: str, folder: Path, repository: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(repository / "src"), "OMP_NUM_THREADS": "1"},
    )


@pytest.fixture
def own_models(tmp_path: Path) -> Path:
    """A folder with a package ``models`` that is the user's."""
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "__init__.py").write_text("")
    (tmp_path / "models" / "mine.py").write_text("WORD = 'mine'\n")
    return tmp_path


@pytest.mark.parametrize("program", [SAME, OTHER_ORDER], ids=["ctus first", "plain first"])
def test_both_names_are_one_module(program: str, tmp_path: Path, repository: Path) -> None:
    ended = run(program, tmp_path, repository)
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize("first", [True, False], ids=["theirs first", "ours first"])
def test_a_package_of_the_users_own_keeps_its_name(first: bool, own_models: Path, repository: Path) -> None:
    ended = run(BESIDE_ANOTHER.format(first=first), own_models, repository)
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize(
    "name", ["ctus.models.no_such_module", "ctus.no_such_package", "ctus.models.masks.x"]
)
def test_a_module_that_is_not_there_is_not_found(name: str, tmp_path: Path, repository: Path) -> None:
    ended = run(f"import {name}", tmp_path, repository)
    assert ended.returncode == 1
    assert f"ModuleNotFoundError: No module named '{name.removesuffix('.x')}'" in ended.stderr


def test_jobs_of_their_own_processes_do_not_see_the_users_package(own_models: Path, repository: Path) -> None:
    program = (
        "import subprocess, sys\n"
        "from experiments.running.local_processes import WORKER\n"
        "ended = subprocess.run([*WORKER], capture_output=True, text=True)\n"
        "assert 'No module named' not in ended.stderr, ended.stderr\n"
        "assert 'running' in ended.stderr, ended.stderr\n"
    )
    ended = run(f"import sys; sys.path.remove('')\n{program}", own_models, repository)
    assert ended.returncode == 0, ended.stderr
