"""The configurations there are, and values for what a study's user must give."""

from __future__ import annotations

import copy
import functools
import hashlib
import os
import pickle
from pathlib import Path
from typing import Any

from experiments.cli import compose_sweep

CONF = Path(__file__).resolve().parents[2] / "conf"
STUDIES = sorted(path.stem for path in (CONF / "study").glob("*.yaml"))
OPTIONS = sorted(
    (path.parent.name, path.stem)
    for path in CONF.glob("*/*.yaml")
    # A launcher belongs to the call; no study takes it.
    if path.parent.name not in ("study", "preset", "launcher")
)
LAUNCHERS = sorted(path.stem for path in (CONF / "launcher").glob("*.yaml"))


# A folder that the test processes share, set at their start; without it each composes for itself.
shared: Path | None = None


@functools.lru_cache(maxsize=512)
def _composed(words: tuple[str, ...], multirun: bool, home: str | None) -> list[dict[str, Any]]:
    key = hashlib.sha256(repr((words, multirun, home)).encode()).hexdigest()
    if shared is not None and (shared / key).is_file():
        found: list[dict[str, Any]] = pickle.loads((shared / key).read_bytes())
        return found
    found = [dict(config) for config, _ in compose_sweep(list(words), multirun=multirun)]
    if shared is not None:
        partial = shared / f"{key}.{os.getpid()}"
        partial.write_bytes(pickle.dumps(found))
        partial.replace(shared / key)
    return found


def composed(*words: str) -> dict[str, Any]:
    """The configuration of a call, composed once for all tests: that takes a third of a second."""
    (config,) = _composed(words, False, os.environ.get("CTUS_HOME"))
    return copy.deepcopy(config)


def composed_at(seeds: tuple[int, ...], *words: str) -> dict[int, dict[str, Any]]:
    """The configurations of a call with each of several seeds; all of them take little longer than one."""
    points = _composed((*words, f"seed={','.join(map(str, seeds))}"), True, os.environ.get("CTUS_HOME"))
    return dict(zip(seeds, copy.deepcopy(points), strict=True))


def mandatory(study: str) -> list[str]:
    """A value for every setting of a study that the user must give."""
    lines = (CONF / "study" / f"{study}.yaml").read_text().splitlines()
    return [f"{line.split(':')[0]}=given" for line in lines if line.split("#")[0].rstrip().endswith(": ???")]


def taker(group: str) -> str:
    """The first study that has a choice of this group."""
    return next(study for study in STUDIES if f"/{group}:" in (CONF / "study" / f"{study}.yaml").read_text())
