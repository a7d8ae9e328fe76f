"""Where the project lies on this machine: its configuration, and the folder that runs and outputs go under."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TypeAlias

# A setting that names a file or a folder that a job reads: what lies there is part of what the job computes. A study's
# run, and the class of an option, say by this annotation (or by Path) which of their settings are such; a word that
# the setting takes besides is listed with it as a Literal. Where results and caches go is no such setting.
PathSetting: TypeAlias = str

_PACKAGE = Path(__file__).resolve().parent
_CHECKOUT = _PACKAGE.parents[1]


def conf_dir() -> Path:
    """Find the folder of configurations: inside the package, in a checkout by a link to ``conf`` at its top.

    Returns
    -------
    Path
        Absolute path.
    """
    return _PACKAGE / "conf"


def project_root() -> Path:
    """Find the folder that ``mlruns``, ``outputs`` and ``results`` lie in.

    Returns
    -------
    Path
        ``CTUS_HOME`` if it is set, else the checkout that the package is imported from, else the current
        folder.
    """
    if home := os.environ.get("CTUS_HOME"):
        return Path(home).expanduser().resolve()
    if (_CHECKOUT / "pyproject.toml").is_file() and (_CHECKOUT / "conf").is_dir():
        return _CHECKOUT
    return Path.cwd()
