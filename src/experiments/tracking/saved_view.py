"""A view of the dashboard that is there from the first run on: one row a result, with the columns of its study.

The dashboard keeps views as tags of an experiment: JSON with the view's name, times in ms and its state, which is
JSON again, compressed.
"""

from __future__ import annotations

import base64
import json
import time
import zlib
from collections.abc import Sequence
from contextlib import suppress

from experiments.tracking.headline import LEVEL_TAG, RESULT

NAME = "Results"
VIEW_TAG = "mlflow.sharedViewState.ctus_results"
# What the dashboard opens an experiment as: its page of runs, not that of language models.
KIND_TAGS = {"mlflow.experimentKind": "custom_model_development"}
MOST_COLUMNS = 24
_PREFIX = "deflate;"
_STATE = {
    "searchFilter": f"tags.{LEVEL_TAG} = '{RESULT}'",
    "orderByKey": "attributes.start_time",
    "orderByAsc": False,
    "startTime": "ALL",
    "lifecycleFilter": "Active",
    "datasetsFilter": [],
    "modelVersionFilter": "All Runs",
    "columnWidths": {},
    "runsHiddenMode": "FIRST_10_RUNS",
    "viewMaximized": False,
    "runListHidden": False,
    "isAccordionReordered": False,
    "useGroupedValuesInCharts": True,
    "hideEmptyCharts": True,
    "groupBy": None,
    "groupsExpanded": {},
}


def view_tag(parameters: Sequence[str], metrics: Sequence[str], before: str = "") -> str:
    """The tag of an experiment that holds its view of results.

    Parameters
    ----------
    parameters, metrics : Sequence[str]
        Names that have columns, in their order.
    before : str, optional
        The tag as it is; its columns are kept, so that studies with other settings do not take each other's away.

    Returns
    -------
    str
        The tag; ``before`` itself where it has all columns already.
    """
    wanted = [f"params.`{name}`" for name in parameters] + [f"metrics.`{name}`" for name in metrics]
    known = columns_of(before)
    if known and set(wanted) <= set(known):
        return before
    columns = list(dict.fromkeys([*known, *wanted]))
    # Parameters come first: they say what the numbers are of.
    columns.sort(key=lambda column: column.startswith("metrics."))
    columns = columns[-MOST_COLUMNS:]
    state = json.dumps({**_STATE, "selectedColumns": columns, "columnOrder": columns})
    packed = base64.b64encode(zlib.compress(state.encode())).decode()
    now_ms = int(time.time() * 1000)
    return json.dumps({"name": NAME, "createdAt": now_ms, "updatedAt": now_ms, "state": f"{_PREFIX}{packed}"})


def columns_of(tag: str) -> list[str]:
    """The columns of a view.

    Parameters
    ----------
    tag : str
        Tag of an experiment, as ``view_tag`` gives it.

    Returns
    -------
    list of str
        Its columns; none where the tag holds no view that can be read.
    """
    with suppress(ValueError, KeyError, TypeError, zlib.error):
        state = json.loads(tag)["state"]
        if state.startswith(_PREFIX):
            state = zlib.decompress(base64.b64decode(state.removeprefix(_PREFIX))).decode()
        return [str(column) for column in json.loads(state)["selectedColumns"]]
    return []
