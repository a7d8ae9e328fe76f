"""What a run was made with and what is here: code, packages, data. With all the same, equal numbers are expected."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from experiments.provenance import COMMIT_TAG, environment_tags
from experiments.running.jobs import hash_now
from experiments.studies.reproduce.configuration import CUT, Prepared, configuration_of
from experiments.tracking import HASH_TAG
from experiments.tracking.run_record import RunRecord

UNKNOWN = "not recorded"
_SHOWN = 12


@dataclass(frozen=True)
class Check:
    """One thing that a run was made with.

    Parameters
    ----------
    what : str
        What was checked.
    recorded, now : str
        What the run says and what is here.
    same : bool or None
        Whether they are the same; None where that can't be told.
    needed : bool, optional
        Whether a difference is a reason not to go on.
    """

    what: str
    recorded: str
    now: str
    same: bool | None
    needed: bool = True

    @property
    def in_the_way(self) -> bool:
        """Whether equal numbers can't be expected for this reason."""
        return self.needed and not self.same

    @property
    def text(self) -> str:
        """What differs, in a few words."""
        return f"{self.what} {self.recorded} (here {self.now})"


def code_checks(record: RunRecord, now: Mapping[str, str] | None = None) -> list[Check]:
    """Compare code, packages and machine of a run with those here.

    Parameters
    ----------
    record : RunRecord
        The run.
    now : Mapping[str, str] or None, optional
        Tags that a run would get here; None asks for them.

    Returns
    -------
    list of Check
        Commit, uncommitted changes, each package whose version differs, Python and machine.
    """
    here = environment_tags() if now is None else now
    commit = [tags.get(COMMIT_TAG, UNKNOWN) for tags in (record.tags, here)]
    python, machine = (
        [tags.get(name, UNKNOWN) for tags in (record.tags, here)] for name in ("ctus.python", "ctus.machine")
    )
    words = {"true": "some", "false": "none"}
    dirty = [words.get(tags.get("ctus.git_dirty", ""), UNKNOWN) for tags in (record.tags, here)]
    return [
        Check("commit", commit[0][:_SHOWN], commit[1][:_SHOWN], commit[0] == commit[1] != UNKNOWN),
        # What was not committed can't be had again, so that it is a difference even where both have some.
        Check("uncommitted changes", dirty[0], dirty[1], dirty == ["none", "none"]),
        *_packages(record.tags.get("ctus.packages"), here.get("ctus.packages")),
        Check("Python", python[0], python[1], python[0] == python[1] != UNKNOWN),
        Check("machine", machine[0], machine[1], machine[0] == machine[1], needed=False),
    ]


def _packages(recorded: str | None, now: str | None) -> list[Check]:
    if not recorded:
        return [Check("packages", UNKNOWN, "", None)]
    versions, here = json.loads(recorded), json.loads(now or "{}")
    others = {name: here.get(name, "not installed") for name in versions if versions[name] != here.get(name)}
    same = len(versions) - len(others)
    found = [Check("packages", f"{same} of {len(versions)} the same", "", True)] if same else []
    return found + [Check(name, versions[name], version, False) for name, version in others.items()]


def configuration_checks(record: RunRecord, job: Prepared) -> list[Check]:
    """Compare the hash of a run, over its configuration and all files that it read, with that here.

    Parameters
    ----------
    record : RunRecord
        The run.
    job : Prepared
        Its configuration as it is run here.

    Returns
    -------
    list of Check
        The hash, the paths that are read from elsewhere, and the settings that the run did not have.
    """
    found = [Check("accelerator", "gpu", "no GPU, run on the CPU", False)] if job.without_gpu else []
    if job.moved or CUT in record.config:
        # The hash is over the paths as well.
        paths = "; ".join(job.moved) or "the same"
        found.append(Check("paths", "as configured", paths, None if job.moved else True, needed=False))
    else:
        hashes = record.tags.get(HASH_TAG, UNKNOWN), hash_now(configuration_of(record))
        same = hashes[0] == hashes[1]
        found.append(Check("configuration and files read", hashes[0][:_SHOWN], hashes[1][:_SHOWN], same))
    if job.lacking:
        found.append(Check("settings", "did not have", ", ".join(job.lacking), None, needed=False))
    return found


def data_checks(recorded: Mapping[str, str], now: Mapping[str, str]) -> list[Check]:
    """Compare the digests of the data sets that a run used with those that were used here.

    Parameters
    ----------
    recorded, now : Mapping[str, str]
        Digest of each data set by its name.

    Returns
    -------
    list of Check
        One for each data set.
    """
    return [
        Check(
            f"data {name}",
            recorded.get(name, UNKNOWN)[:_SHOWN],
            now.get(name, "not used")[:_SHOWN],
            None if name not in recorded else _same_digest(recorded[name], now.get(name, "")),
            needed=name in recorded,
        )
        for name in sorted({*recorded, *now})
    ]


def _same_digest(one: str, other: str) -> bool:
    # The tracker keeps the beginning of a digest, a table of cases the whole.
    shorter = min(len(one), len(other))
    return one == other or (shorter >= _SHOWN and one[:shorter] == other[:shorter])


def recorded_digests(record: RunRecord, inputs: Mapping[str, str]) -> dict[str, str]:
    """Collect what a run says of the contents of its data sets.

    Parameters
    ----------
    record : RunRecord
        The run.
    inputs : Mapping[str, str]
        Digest by the name of the data set, as the run recorded them; empty for a run from an archive of before.

    Returns
    -------
    dict of str to str
        Digest by the name of the data set, also from the columns ``dataset`` and ``data_digest`` of its cases.
    """
    cases = record.cases
    if cases is None or not {"dataset", "data_digest"} <= {*cases}:
        return dict(inputs)
    known = cases[["dataset", "data_digest"]].dropna().drop_duplicates()
    return {**dict(zip(known["dataset"], known["data_digest"], strict=True)), **inputs}


def differing(checks: Sequence[Check]) -> tuple[str, ...]:
    """List what stands in the way of equal numbers, each once.

    Parameters
    ----------
    checks : sequence of Check
        The checks of all runs.

    Returns
    -------
    tuple of str
        What differs.
    """
    return tuple(dict.fromkeys(check.text for check in checks if check.in_the_way))
