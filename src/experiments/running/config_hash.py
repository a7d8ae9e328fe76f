"""What makes two jobs the same job: the hash of the resolved configuration and of what lies under its paths."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

# How a job is run, where its results go and how it is tracked do not change what it computes.
# Neither does ``call``, the words of the command line, which the rest of the configuration already is.
NOT_PART_OF_THE_JOB = frozenset(
    {"tracking", "resume", "out", "workers", "jobs", "launcher", "dry_run", "call"}
)
# The same, wherever they stand: a folder that only saves work, how many processes share it, and whether what was
# interrupted is resumed.
NEVER_PART = frozenset({"cache", "resume", "workers"})


def job_config(config: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a resolved configuration that decides the result.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.

    Returns
    -------
    dict[str, Any]
        The part of the configuration.
    """
    return {key: value for key, value in config.items() if key not in NOT_PART_OF_THE_JOB}


def config_hash(config: Mapping[str, Any], contents: Mapping[str, str]) -> str:
    """SHA-256 over the canonical JSON of the job's configuration and the digests of what it reads.

    ``contents`` has the digest of what lies under each path that the job reads. A file that changes under the same
    name, or inside a folder of the same name, makes another job, so that ``resume=true`` never takes an old result for
    a new input. Order of keys does not matter; 1 and 1.0 are the same number.

    Parameters
    ----------
    config : Mapping[str, Any]
        A resolved configuration.
    contents : Mapping[str, str]
        Digest of what lies under each path that is read, by path.

    Returns
    -------
    str
        The hash in hexadecimal.
    """
    read = {path: contents[path] for path in sorted(contents)}
    canonical = json.dumps(
        {"config": _canonical(job_config(config)), "files": read}, sort_keys=True, separators=(",", ":")
    )
    return hashlib.sha256(canonical.encode()).hexdigest()


def _canonical(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _canonical(item) for key, item in value.items() if key not in NEVER_PART}
    if isinstance(value, (list, tuple)):
        return [_canonical(item) for item in value]
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value
