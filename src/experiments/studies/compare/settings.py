"""Settings and metrics of two runs that are not the same."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from experiments.analysis.runs.paired_cases import settings_that_differ
from experiments.analysis.runs.timing import is_timing
from experiments.provenance import COMMIT_TAG
from experiments.running.config_hash import NEVER_PART, job_config
from experiments.tracking.names import flatten
from experiments.tracking.run_lookup import Family
from experiments.tracking.run_record import RunRecord, config_of, last_metrics

if TYPE_CHECKING:
    import pandas as pd

NOT_SET = "not set"
LONGEST = 60
# What else two results may differ by.
_MADE_WITH = {
    COMMIT_TAG: "commit",
    "ctus.git_dirty": "uncommitted changes",
    "ctus.machine": "machine",
    "ctus.python": "Python",
}


def differing_settings(first: Family, second: Family, names: tuple[str, str]) -> pd.DataFrame:
    """Tabulate the settings that differ, and the code, packages and machine where these do.

    Parameters
    ----------
    first, second : Family
        The runs. A setting that varies over the jobs of a run has all of its values.
    names : tuple of str, str
        Names of the columns.

    Returns
    -------
    pandas.DataFrame
        One row for each setting.
    """
    import pandas as pd

    rows = []
    for collect in (_settings, _made_with):
        values = [collect(family) for family in (first, second)]
        for key in settings_that_differ(*values):
            shown = [_shown(each.get(key)) for each in values]
            rows.append({"setting": key, names[0]: shown[0], names[1]: shown[1]})
    return pd.DataFrame(rows, columns=["setting", *names])


def differing_metrics(first: Family, second: Family, names: tuple[str, str]) -> pd.DataFrame:
    """Tabulate the metrics of both runs that differ, without runtimes and without counts of the call.

    Parameters
    ----------
    first, second : Family
        The runs.
    names : tuple of str, str
        Names of the columns.

    Returns
    -------
    pandas.DataFrame
        One row for each metric that both have, with the difference, first less second.
    """
    import pandas as pd

    values = [_last_values(family.run) for family in (first, second)]
    rows = [
        {
            "metric": name,
            names[0]: values[0][name],
            names[1]: values[1][name],
            "difference": values[0][name] - values[1][name],
        }
        for name in sorted({*values[0]} & {*values[1]})
        if values[0][name] != values[1][name] and not is_timing(name)
    ]
    return pd.DataFrame(rows, columns=["metric", *names, "difference"])


def _last_values(record: RunRecord) -> dict[str, float]:
    return {name: value for name, value in last_metrics(record).items() if math.isfinite(value)}


def _settings(family: Family) -> dict[str, tuple[str, ...]]:
    """The values of every setting over the jobs of a run."""
    found: dict[str, dict[str, None]] = {}
    for job in family.jobs:
        config = config_of(job.config)
        for key, value in flatten(_plain(job_config(config or {}))).items():
            found.setdefault(key, {})[str(value)] = None
    return {key: tuple(sorted(values)) for key, values in found.items()}


def _plain(node: object) -> dict[str, object]:
    """A configuration without what only saves work; a list is a mapping by place, so that one item may differ."""
    if isinstance(node, list):
        node = {str(place): item for place, item in enumerate(node)}
    assert isinstance(node, Mapping)
    return {
        str(key): _plain(value)
        if isinstance(value, Mapping)
        or (isinstance(value, list) and any(isinstance(i, Mapping) for i in value))
        else value
        for key, value in node.items()
        if key not in NEVER_PART
    }


def _made_with(family: Family) -> dict[str, tuple[str, ...]]:
    found: dict[str, dict[str, None]] = {}
    for job in family.jobs:
        for tag, name in _MADE_WITH.items():
            found.setdefault(name, {})[job.tags.get(tag, "not recorded")] = None
        for package, version in json.loads(job.tags.get("ctus.packages", "{}")).items():
            found.setdefault(f"package {package}", {})[version] = None
    return {name: tuple(sorted(values)) for name, values in found.items()}


def _shown(values: tuple[str, ...] | None) -> str:
    text = NOT_SET if values is None else " | ".join(values)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
