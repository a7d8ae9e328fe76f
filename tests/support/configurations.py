"""The configurations there are, and values for what a study's user must give."""

from __future__ import annotations

import copy
import functools
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


@functools.lru_cache(maxsize=512)
def _composed(words: tuple[str, ...]) -> Any:
    ((config, _),) = compose_sweep(list(words))
    return config


def composed(*words: str) -> dict[str, Any]:
    """The configuration of a call, composed once in a process: that takes a third of a second."""
    found: dict[str, Any] = copy.deepcopy(_composed(words))
    return found


def composed_at(seeds: tuple[int, ...], *words: str) -> dict[int, dict[str, Any]]:
    """The configurations of a call with each of several seeds; all of them take little longer than one."""
    points = compose_sweep([*words, f"seed={','.join(map(str, seeds))}"], multirun=True)
    return dict(zip(seeds, (dict(config) for config, _ in points), strict=True))


def mandatory(study: str) -> list[str]:
    """A value for every setting of a study that the user must give."""
    lines = (CONF / "study" / f"{study}.yaml").read_text().splitlines()
    return [f"{line.split(':')[0]}=given" for line in lines if line.split("#")[0].rstrip().endswith(": ???")]


def taker(group: str) -> str:
    """The first study that has a choice of this group."""
    return next(study for study in STUDIES if f"/{group}:" in (CONF / "study" / f"{study}.yaml").read_text())
