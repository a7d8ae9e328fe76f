"""What the thesis published, read from ``conf/published.yaml``, to stand beside what is measured here."""

from __future__ import annotations

from dataclasses import dataclass

import yaml

from experiments.errors import InputError
from experiments.paths import conf_dir

RELATIONS = {"below": "<", "about": "about"}
NOT_COMPARABLE = "not comparable"


@dataclass(frozen=True)
class Published:
    """One published value: ``value`` as ``relation`` says (below, about), on which ``data``, and its ``place``."""

    value: float
    relation: str
    data: str
    place: str

    def __post_init__(self) -> None:
        if self.relation not in RELATIONS:
            raise InputError(f"relation: expected {', '.join(RELATIONS)}, received {self.relation!r}")

    @property
    def text(self) -> str:
        """The value as a reader takes it."""
        return f"{RELATIONS[self.relation]} {self.value:g}"

    def beside(self, simulated: bool) -> str:
        """What stands beside a measured value: numbers of simulated data are not comparable with a laboratory's."""
        return f"{self.text} ({NOT_COMPARABLE}: simulated)" if simulated else self.text


def published(study: str, metric: str) -> Published:
    """The published value of a study's metric; InputError where there is none."""
    known = yaml.safe_load((conf_dir() / "published.yaml").read_text(encoding="utf-8"))
    try:
        return Published(**known[study][metric])
    except KeyError as missing:
        raise InputError(
            f"published: expected a value of {study}.{metric}, found none for {missing}"
        ) from missing
