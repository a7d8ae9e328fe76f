"""Values that the thesis published, read from ``conf/published.yaml``, for comparison with measured ones."""

from __future__ import annotations

from dataclasses import dataclass

import yaml

from experiments.errors import InputError
from experiments.paths import conf_dir

RELATIONS = {"below": "<", "about": "about"}
NOT_COMPARABLE = "not comparable"


@dataclass(frozen=True)
class Published:
    """One published value.

    Parameters
    ----------
    value : float
        The value.
    relation : {"below", "about"}
        How it was stated.
    data : str
        Data it was measured on.
    place : str
        Place of publication.

    Raises
    ------
    InputError
        If the relation is unknown.
    """

    value: float
    relation: str
    data: str
    place: str

    def __post_init__(self) -> None:
        if self.relation not in RELATIONS:
            raise InputError(f"relation: expected {', '.join(RELATIONS)}, received {self.relation!r}")

    @property
    def text(self) -> str:
        """The value with its relation, as text."""
        return f"{RELATIONS[self.relation]} {self.value:g}"

    def text_for(self, simulated: bool) -> str:
        """Format the value for a table next to a measured one.

        Parameters
        ----------
        simulated : bool
            Whether the measured value comes from simulated data, which are not comparable with a
            laboratory's.

        Returns
        -------
        str
            The value, marked where it is not comparable.
        """
        return f"{self.text} ({NOT_COMPARABLE}: simulated)" if simulated else self.text


def published(study: str, metric: str) -> Published:
    """Return the published value of a metric.

    Parameters
    ----------
    study : str
        Name of the study.
    metric : str
        Name of the metric.

    Returns
    -------
    Published
        The value.

    Raises
    ------
    InputError
        If there is none.
    """
    known = yaml.safe_load((conf_dir() / "published.yaml").read_text(encoding="utf-8"))
    try:
        return Published(**known[study][metric])
    except KeyError as missing:
        raise InputError(
            f"published: expected a value of {study}.{metric}, found none for {missing}"
        ) from missing
