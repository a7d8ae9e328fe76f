"""What every call of the command line has, checked before any work starts: the shared settings and where results go."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.errors import InputError, did_you_mean
from models.value_types import mismatch

# The settings that no study takes itself, by their dotted names.
SHARED: dict[str, Any] = {
    "seed": int | None,
    "out": str | int | None,
    "resume": bool,
    "dry_run": bool,
    "tracking.uri": str | None,
    "tracking.enabled": bool,
}
_TRIES, _PAUSE_S = 5, 0.02


def require_shared(config: Mapping[str, Any]) -> None:
    """Refuse a call whose shared settings are of another type than they must be.

    Parameters
    ----------
    config : Mapping[str, Any]
        The composed configuration as plain data.

    Raises
    ------
    InputError
        If one of ``SHARED`` is of another type, the tracker is given an unknown setting, or ``seed`` is below
        0.
    """
    tracking = config.get("tracking")
    if not isinstance(tracking, Mapping):
        raise InputError(f"tracking: expected settings of the tracker (uri, enabled), received {tracking!r}")
    known = [name.removeprefix("tracking.") for name in SHARED if name.startswith("tracking.")]
    for name in tracking:
        if name not in known:
            raise InputError(
                f"tracking.{name}: expected a setting of the tracker ({', '.join(known)}), received an unknown one"
                f"{did_you_mean(str(name), known)}"
            )
    for name, wanted in SHARED.items():
        group, _, key = name.rpartition(".")
        values: Mapping[str, Any] = tracking if group else config
        if key in values and (wrong := mismatch(name, values[key], wanted)) is not None:
            raise InputError(wrong)
    seed = config.get("seed")
    if seed is not None and seed < 0:
        raise InputError(f"seed: expected a whole number from 0, received {seed}")


def require_writable(folder: Path) -> None:
    """Refuse a folder that results can't be written to, by trying; nothing that was made stays.

    Parameters
    ----------
    folder : Path
        Folder of the results; it need not exist.

    Raises
    ------
    InputError
        If ``folder`` is a file, or it or its parent can't be made or take files.

    Notes
    -----
    Results are first written to a temporary folder next to their own, so its parent must take files too. The
    permissions are not asked: they don't bind root, and a file system can be mounted read-only.
    """
    for left in reversed(range(_TRIES)):
        try:
            _try_to_write(folder)
        except InputError:
            raise
        except (OSError, ValueError) as error:
            # Another call that tries at the same time takes away what it made, the common parent too.
            if left and isinstance(error, FileNotFoundError):
                time.sleep(_PAUSE_S)
                continue
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError(
                f"out: expected a folder that can be written, received {str(folder)!r}: {reason}"
            ) from error
        return


def _try_to_write(folder: Path) -> None:
    missing: list[Path] = []
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"out: expected a folder for the results, received the file {str(folder)!r}")
        missing = [each for each in folder.parents if not each.exists()]
        folder.parent.mkdir(parents=True, exist_ok=True)
        for parent in [folder.parent, folder] if folder.exists() else [folder.parent]:
            Path(tempfile.mkdtemp(prefix=f".{folder.name}.partial-", dir=parent)).rmdir()
    finally:
        for each in missing:
            with contextlib.suppress(OSError):
                each.rmdir()
