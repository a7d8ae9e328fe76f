"""What tracked runs tell of themselves: settings, data, code, numbers of units and cases, scores with intervals."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from experiments.analysis.runs.paired_cases import UNITS, cases_of, digests_of
from experiments.provenance import COMMIT_TAG
from experiments.statistics import Bootstrap, by_unit, wilson_interval
from experiments.tracking.archive import without_folders
from experiments.tracking.names import flatten
from experiments.tracking.run_lookup import Family
from experiments.tracking.run_record import RunRecord, config_of

if TYPE_CHECKING:
    import pandas as pd

# Settings that say how something was run and not what it is.
_NOT_TOLD = frozenset({"cache", "workers", "resume", "_target_"})
# What tells the rows of a table of cases apart that must not be mixed.
_PARTS = ("network", "method", "model", "step", "train_dataset", "dataset", "part")


@dataclass(frozen=True)
class Facts:
    """The runs that are reported.

    Parameters
    ----------
    families : tuple of Family
        Runs with all runs below them.
    """

    families: tuple[Family, ...]

    @cached_property
    def jobs(self) -> tuple[RunRecord, ...]:
        """All finished jobs."""
        return tuple(job for family in self.families for job in family.jobs if job.status == "FINISHED")

    @cached_property
    def configs(self) -> tuple[Mapping[str, Any], ...]:
        """Their configurations."""
        return tuple(config_of(job.config) for job in self.jobs if job.config)

    @cached_property
    def tables(self) -> tuple[pd.DataFrame, ...]:
        """The cases of each run that has any."""
        having = [family for family in self.families if any(job.cases is not None for job in family.jobs)]
        return tuple(cases_of(family) for family in having)

    @cached_property
    def digests(self) -> dict[str, str]:
        """Digest of each data set, by its name."""
        return {name: digest for family in self.families for name, digest in digests_of(family).items()}

    def settings(self, *places: str) -> tuple[str, ...]:
        """Describe parts of the configurations.

        Parameters
        ----------
        *places : str
            Names of settings at the top, such as ``trainer``.

        Returns
        -------
        tuple of str
            One text for each setting that some run has: its name, class and values; where jobs differ, all of them.
        """
        found = []
        for place in places:
            values = [config[place] for config in self.configs if config.get(place) is not None]
            if values:
                found.append(f"{place}: {without_folders(_text(_merged(values)))}")
        return tuple(found)

    def values(self, setting: str) -> tuple[str, ...]:
        """List the values of a dotted setting over all jobs.

        Parameters
        ----------
        setting : str
            Dotted name.

        Returns
        -------
        tuple of str
            Different values, those that are null left out.
        """
        flat = (flatten(config) for config in self.configs)
        found = dict.fromkeys(str(each[setting]) for each in flat if each.get(setting) is not None)
        return tuple(found)

    def tags(self, name: str) -> tuple[str, ...]:
        """List the values of a tag over all jobs.

        Parameters
        ----------
        name : str
            Name of the tag.

        Returns
        -------
        tuple of str
            Different values.
        """
        return tuple(dict.fromkeys(job.tags[name] for job in self.jobs if job.tags.get(name)))

    def packages(self) -> tuple[str, ...]:
        """List the packages with all versions that were used.

        Returns
        -------
        tuple of str
            ``name version``, several versions with strokes.
        """
        found: dict[str, dict[str, None]] = {}
        for text in self.tags("ctus.packages"):
            for name, version in json.loads(text).items():
                found.setdefault(name, {})[version] = None
        return tuple(f"{name} {' | '.join(versions)}" for name, versions in found.items())

    def commits(self) -> tuple[str, ...]:
        """List the commits of the code.

        Returns
        -------
        tuple of str
            First characters of each, with a word on uncommitted changes.
        """
        found: dict[str, None] = {}
        for job in self.jobs:
            if commit := job.tags.get(COMMIT_TAG):
                dirty = " with uncommitted changes" if job.tags.get("ctus.git_dirty") == "true" else ""
                found[f"{commit[:12]}{dirty}"] = None
        return tuple(found)

    def parts(self, metric: str) -> Iterator[tuple[str, pd.DataFrame, str]]:
        """Go through the cases that belong together and have a metric.

        Parameters
        ----------
        metric : str
            Column of the metric.

        Yields
        ------
        str
            Method or model, data set and part of the split.
        pandas.DataFrame
            Cases with a value of the metric.
        str
            Column of the independent unit.
        """
        for table in self.tables:
            unit = next((name for name in UNITS if name in table), None)
            if metric not in table or unit is None:
                continue
            scored = table.dropna(subset=metric)
            columns = [name for name in _PARTS if name in scored]
            groups = scored.groupby(columns, sort=False, dropna=False) if columns else [((), scored)]
            for values, cases in groups:
                if len(cases):
                    yield ", ".join(str(value) for value in values), cases, unit

    def simulated(self) -> bool | None:
        """Whether the cases are simulated.

        Returns
        -------
        bool or None
            True or False where all cases say the same; None where they do not or nothing is said.
        """
        found = {bool(value) for table in self.tables if "simulated" in table for value in table["simulated"]}
        return found.pop() if len(found) == 1 else None


def mean_with_interval(cases: pd.DataFrame, metric: str, unit: str) -> str:
    """Write the mean of a metric over units with its interval.

    Parameters
    ----------
    cases : pandas.DataFrame
        The cases.
    metric : str
        Column of the metric.
    unit : str
        Column of the independent unit.

    Returns
    -------
    str
        Mean of the units' means, bootstrap 95 % interval over units and n.
    """
    found = Bootstrap()(by_unit(cases, metric, unit))
    bounds = "" if math.isnan(found.low) else f" (95 % interval {found.low:.3g} to {found.high:.3g})"
    return f"{metric} {found.estimate:.3g}{bounds}, n = {found.units} {unit}{_plural(found.units)}, {len(cases)} rows"


def rate_with_interval(cases: pd.DataFrame, metric: str, unit: str) -> str:
    """Write the rate of a metric that is true or false, over rows, and over units where there are several.

    Parameters
    ----------
    cases : pandas.DataFrame
        The cases.
    metric : str
        Column of the metric.
    unit : str
        Column of the independent unit.

    Returns
    -------
    str
        Count and share; the mean over units with a bootstrap 95 % interval where rows share units, else Wilson's.
    """
    won = cases[metric].astype(float)
    units = cases[unit].nunique()
    text = f"{metric} {won.sum():.0f} of {len(won)} ({won.mean():.3g})"
    if 1 < units < len(won):
        # Rows of one unit are not independent: an interval over rows would be too narrow.
        return f"{text}; over units {mean_with_interval(cases.assign(**{metric: won}), metric, unit)}"
    share = wilson_interval(round(float(won.sum())), len(won))
    of = f", of these trials on a single {unit}, not of others" if units == 1 else ""
    return f"{text}, Wilson 95 % interval {share.low:.3g} to {share.high:.3g}{of}"


def _merged(values: Sequence[Any]) -> Any:
    """One value for those of several jobs: what differs with strokes between, settings of one class one by one."""
    first = values[0]
    if all(value == first for value in values):
        return first
    if all(isinstance(value, Mapping) and {*value} == {*first} for value in values):
        return {key: _merged([value[key] for value in values]) for key in first}
    return " | ".join(dict.fromkeys(_text(value) for value in values))


def _text(node: Any) -> str:
    """A part of a configuration in one line: class and settings."""
    if isinstance(node, Mapping):
        name = str(node.get("_target_", "")).rpartition(".")[2]
        inside = ", ".join(f"{key}={_text(value)}" for key, value in node.items() if key not in _NOT_TOLD)
        return f"{name}({inside})" if name else f"{{{inside}}}"
    if isinstance(node, Sequence) and not isinstance(node, str):
        return f"[{', '.join(_text(item) for item in node)}]"
    return str(node)


def _plural(count: int) -> str:
    return "" if count == 1 else "s"
