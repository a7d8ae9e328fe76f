"""What makes two jobs the same job: the hash of the resolved configuration and of the files it names."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from experiments import files

# How a job is run, where its results go and how it is tracked do not change what it computes.
NOT_PART_OF_THE_JOB = frozenset({"tracking", "resume", "out", "workers", "jobs"})
# The same, wherever they stand: a folder that only saves work, how many processes share it, and whether what was
# interrupted is gone on with.
_NEVER_PART = frozenset({"cache", "resume", "workers"})


def job_config(config: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a resolved configuration that decides the result."""
    return {key: value for key, value in config.items() if key not in NOT_PART_OF_THE_JOB}


def config_hash(config: Mapping[str, Any]) -> str:
    """SHA-256 over the canonical JSON of the job's configuration and the contents of the files it names.

    A file that changes under the same name makes another job, so that ``resume=true`` never takes an old result for
    a new input. Order of keys does not matter; 1 and 1.0 are the same number.
    """
    job = job_config(config)
    named = {value: files.digest(Path(value)) for value in sorted(set(_strings(job))) if _names_a_file(value)}
    canonical = json.dumps({"config": _canonical(job), "files": named}, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()


def flatten(config: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """One level of dotted keys, as the tracker's parameters want it; an empty mapping or list stays a value."""
    flat: dict[str, Any] = {}
    for key, value in config.items():
        dotted = f"{prefix}{key}"
        if isinstance(value, Mapping) and value:
            flat.update(flatten(value, f"{dotted}."))
        else:
            flat[dotted] = value
    return flat


def _canonical(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _canonical(item) for key, item in value.items() if key not in _NEVER_PART}
    if isinstance(value, (list, tuple)):
        return [_canonical(item) for item in value]
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value


def _strings(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from _strings(item)
    elif isinstance(value, (list, tuple)):
        for item in value:
            yield from _strings(item)


def _names_a_file(value: str) -> bool:
    # A value such as a long formula or one with a NUL byte is no path; asking the system would raise.
    if not value or len(value) > 4096 or "\0" in value:
        return False
    try:
        return Path(value).expanduser().is_file()
    except OSError:
        return False
