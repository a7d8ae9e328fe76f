"""Values that the thesis published, read from ``conf/published.yaml``, for comparison with measured ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import yaml

from experiments.errors import InputError
from experiments.paths import conf_dir

RELATIONS = {
    "below": "<",
    "above": ">",
    "about": "about",
    "range": "",
    "lowest": "down to",
    "stated": "",
}
PERCENT = "%"
NOT_COMPARABLE = "not comparable"


@dataclass(frozen=True)
class Published:
    """One published value, or a published sentence without a number.

    Parameters
    ----------
    value : float
        The value as printed, of a range its lower end; NaN where the relation is ``stated``.
    relation : {"below", "above", "about", "range", "lowest", "stated"}
        How it was stated; ``lowest`` is the lowest of several.
    data : str
        Data it was measured on.
    place : str
        Place of publication.
    upper : float or None, optional
        Upper end of a range as printed; None for every other relation.
    unit : str, optional
        Unit of the printed value; empty where it has none.
    metric : str, optional
        Name of the metric as the studies have it.
    dataset : str or sequence of str, optional
        Data sets as the studies name them.
    condition : mapping of str to str or sequence of str, optional
        What the value is of: models, configurations, phantoms and the like.
    statement : str, optional
        The sentence where the relation is ``stated``.

    Raises
    ------
    InputError
        If the relation is unknown, or does not go with the numbers.
    """

    value: float
    relation: str
    data: str
    place: str
    upper: float | None = None
    unit: str = ""
    metric: str = ""
    dataset: Sequence[str] = ()
    condition: Mapping[str, Sequence[str]] = field(default_factory=dict)
    statement: str = ""

    def __post_init__(self) -> None:
        if self.relation not in RELATIONS:
            raise InputError(f"relation: expected {', '.join(RELATIONS)}, received {self.relation!r}")
        if (self.relation == "range") != (self.upper is not None):
            raise InputError(f"upper: expected an end of a range and of nothing else, received {self.upper}")
        if self.upper is not None and not self.value < self.upper:
            raise InputError(f"upper: expected more than {self.value:g}, received {self.upper:g}")
        if (self.relation == "stated") != (bool(self.statement) and math.isnan(self.value)):
            raise InputError(
                f"statement: expected a sentence or a value, received {self.statement!r} and {self.value}"
            )
        object.__setattr__(self, "dataset", _several(self.dataset))
        object.__setattr__(self, "condition", {key: _several(one) for key, one in self.condition.items()})

    @property
    def text(self) -> str:
        """The value with its relation, as text without the unit; a statement as it is."""
        if self.relation == "stated":
            return self.statement
        number = f"{self.value:g}" if self.upper is None else f"{self.value:g} to {self.upper:g}"
        return f"{RELATIONS[self.relation]} {number}".strip()

    @property
    def text_with_unit(self) -> str:
        """The value with its relation and unit, as text."""
        return self.text if self.relation == "stated" else f"{self.text} {self.unit}".strip()

    @property
    def bounds(self) -> tuple[float, float]:
        """Ends between which the value was published, in the metric's own unit: a share where % is printed.

        A value that is no bound has both ends equal, a statement NaN.
        """
        factor = 0.01 if self.unit == PERCENT else 1.0
        low, high = factor * self.value, factor * (self.value if self.upper is None else self.upper)
        if self.relation == "below":
            return -math.inf, high
        return (low, math.inf) if self.relation == "above" else (low, high)

    def met(self, measured: float) -> bool | None:
        """Tell whether a measured value lies within the published bounds.

        Parameters
        ----------
        measured : float
            Measured value, in the metric's own unit.

        Returns
        -------
        bool or None
            None where no bounds were published: how near is near enough to "about 1.4" is not stated.
        """
        low, high = self.bounds
        if not low < high:
            return None
        return low <= measured <= high if self.relation == "range" else low < measured < high

    def difference(self, measured: float) -> float:
        """Compute how far a measured value lies from what was published.

        Parameters
        ----------
        measured : float
            Measured value, in the metric's own unit.

        Returns
        -------
        float
            Signed difference to the nearest published value, 0 within the bounds; NaN for a statement.
        """
        low, high = self.bounds
        return measured - min(max(measured, low), high) if not math.isnan(low) else math.nan

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
    """Return one published value by its name.

    Parameters
    ----------
    study : str
        Name of the study.
    metric : str
        Name of the value in the study's list: that of the metric where it has one value.

    Returns
    -------
    Published
        The value.

    Raises
    ------
    InputError
        If there is none.
    """
    try:
        return published_values()[study][metric]
    except KeyError as missing:
        raise InputError(
            f"published: expected a value of {study}.{metric}, found none for {missing}"
        ) from missing


@lru_cache(maxsize=1)
def published_values() -> Mapping[str, Mapping[str, Published]]:
    """Read all published values.

    Returns
    -------
    mapping of str to mapping of str to Published
        Values by study and name, in the order of the file.
    """
    known = yaml.safe_load((conf_dir() / "published.yaml").read_text(encoding="utf-8"))
    return {
        study: {name: _read(name, record) for name, record in values.items()}
        for study, values in known.items()
    }


def matching(
    study: str, metric: str, *, dataset: str | None = None, stated: bool = False, **condition: str
) -> tuple[Published, ...]:
    """List the published values of a metric that a measured value may be shown with.

    Parameters
    ----------
    study : str
        Name of the study.
    metric : str
        Name of the metric.
    dataset : str or None, optional
        Data set of the measured value; None matches every data set.
    stated : bool, optional
        Whether to list sentences without a number as well.
    **condition : str
        What was measured: model, configuration, phantom and the like.

    Returns
    -------
    tuple of Published
        Values whose conditions agree with ``condition``. A value matches any model where it names none; a value that
        names a condition which is not given here does not match.
    """
    return tuple(
        value
        for value in published_values().get(study, {}).values()
        if value.metric == metric
        and (stated or value.relation != "stated")
        and (dataset is None or dataset in value.dataset)
        and all(condition.get(key) in known for key, known in value.condition.items())
    )


def name_of(study: str, value: Published) -> str:
    """Give the name of a published value in its study's list.

    Parameters
    ----------
    study : str
        Name of the study.
    value : Published
        The value.

    Returns
    -------
    str
        Its name.

    Raises
    ------
    InputError
        If the study has no such value.
    """
    for name, known in published_values().get(study, {}).items():
        if known == value:
            return name
    raise InputError(f"published: expected a value of {study}, received {value.text_with_unit!r}")


def _read(name: str, record: Mapping[str, Any]) -> Published:
    return Published(**{"value": math.nan, "metric": name, **record})


def _several(names: str | Sequence[str]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)
