"""What every call of the command line has, checked before any work starts: the shared settings and where results go."""

from __future__ import annotations

import contextlib
import tempfile
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
    "tracking.uri": str | None,
    "tracking.enabled": bool,
}


def require_shared(config: Mapping[str, Any]) -> None:
    """Raise InputError unless the settings that every call has are of their types, and ``seed`` is none below 0.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.
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
    """Raise InputError unless results can be written to ``folder``, by trying; nothing that was made stays.

    Results are first written beside their folder, so its parent must take files too. What the permissions say is not
    asked: they don't bind root, and a file system can be mounted for reading alone.

    Parameters
    ----------
    folder : Path
        Folder for the results.
    """
    missing: list[Path] = []
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"out: expected a folder for the results, received the file {str(folder)!r}")
        missing = [each for each in folder.parents if not each.exists()]
        folder.parent.mkdir(parents=True, exist_ok=True)
        for parent in [folder.parent, folder] if folder.exists() else [folder.parent]:
            Path(tempfile.mkdtemp(prefix=f".{folder.name}.partial-", dir=parent)).rmdir()
    except InputError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"out: expected a folder that can be written, received {str(folder)!r}: {reason}"
        ) from error
    finally:
        for each in missing:
            with contextlib.suppress(OSError):
                each.rmdir()
