"""Study ``checklist``: reporting checklists filled from tracked runs, with what no run can tell listed as missing."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from experiments import files
from experiments.errors import InputError
from experiments.outcome import Outcome
from experiments.studies.checklist.claim import claim
from experiments.studies.checklist.facts import Facts
from experiments.studies.checklist.items import FILLED, IN_PART, MISSING, Checklist, markdown, state
from experiments.studies.checklist.registration import registration_accuracy
from experiments.tracking import Store
from experiments.tracking.run_lookup import find_families

if TYPE_CHECKING:
    import pandas as pd

TRACKED = False
_ASKS_LONGEST = 60


def run(*, runs: Sequence[str], archive: str | None, store: Store) -> Outcome:
    """Fill the checklists that fit the runs.

    Parameters
    ----------
    runs : sequence of str
        Ids of the runs or sweeps, or the first characters of them.
    archive : str or None
        Folder of exported runs; None for the tracker.
    store : Store
        The tracker.

    Returns
    -------
    Outcome
        ``claim_2024.md`` for runs that score masks, ``registration_accuracy.md`` for runs that measure surfaces or
        poses; how many items are filled, and which are missing.

    Raises
    ------
    InputError
        If there is no such run, or one that measures neither.
    """
    if isinstance(runs, str) or not runs:
        raise InputError(f"runs: expected a list of ids, runs=[...], received {runs!r}")
    place = None if archive is None else Path(archive).expanduser()
    facts = Facts(tuple(find_families([str(each) for each in dict.fromkeys(runs)], store, place)))
    if not facts.jobs:
        raise InputError("runs: expected runs that finished, found none")
    chosen = _fitting(facts)
    tables, findings, written = {}, [], {}
    metrics: dict[str, float] = {}
    for name, checklist in chosen.items():
        filled = checklist.filled(facts)
        written[f"{name}.md"] = partial(files.write_text, text=markdown(checklist, filled, facts))
        counts = {
            each: [item.number for item, filling in filled if state(filling) == each] for each in _STATES
        }
        metrics |= {
            f"{name}_{each.replace(' ', '_')}": float(len(numbers)) for each, numbers in counts.items()
        }
        tables[checklist.title] = _table(checklist, facts)
        findings.append(
            f"{checklist.title}: {len(counts[FILLED])} of {len(filled)} items filled from the runs, "
            f"{len(counts[IN_PART])} in part ({', '.join(counts[IN_PART]) or 'none'}); to be written: "
            f"{', '.join(counts[MISSING]) or 'none'}. See {name}.md."
        )
    return Outcome(metrics=metrics, tables=tables, findings=tuple(findings), files=written)


_STATES = (FILLED, IN_PART, MISSING)


def _fitting(facts: Facts) -> dict[str, Checklist]:
    """The checklists whose measures the runs have."""
    having = {str(name) for table in facts.tables for name in table}
    found = {}
    if having & {"dsc", "missed"}:
        found["claim_2024"] = claim()
    if having & {"tre_mm", "rmse_mm", "msd_mm", "hd95_covered_mm"}:
        found["registration_accuracy"] = registration_accuracy()
    if not found:
        raise InputError(
            "runs: expected runs with cases that score masks (dsc) or registrations (tre_mm, rmse_mm, msd_mm), "
            "found none"
        )
    return found


def _table(checklist: Checklist, facts: Facts) -> pd.DataFrame:
    import pandas as pd

    rows = [
        {
            "item": item.number,
            "asks": item.asks[:_ASKS_LONGEST],
            "state": state(filling),
            "told": len(filling.told),
        }
        for item, filling in checklist.filled(facts)
    ]
    return pd.DataFrame(rows)
