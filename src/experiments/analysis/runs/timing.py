"""Which numbers of a run say how long it took or what it needed, and differ every time it is run."""

from __future__ import annotations

import re

# What a summary or a sweep adds to the name of a metric. A count (``_n``) is none of them: it is the same every time.
_STATISTIC = re.compile(
    r"(?:_(?:mean|std|median|p95|min|max|low|high|ci_low|ci_high|failed|std_over_jobs))+$"
)
# Times that are measured in the data, not taken by the program.
_MEASURED = re.compile(r"(?:^|_)(?:lag|offset|time|gap|latency|interval|period|duration)_s$")
_RESOURCE = re.compile(
    r"(?:^|_)(?:s|memory_mb|memory_mib|rss_mb)$|_per_s$|^seconds(?:_|$)|_seconds$|^cost(?:_|$)"
)
# How a call went, not what it found: a sweep that was resumed computed fewer jobs.
_OF_THE_CALL = frozenset({"jobs_resumed", "timestamp_ms", "date", "started", "machine"})


def base_name(name: str) -> str:
    """Take a statistic and what stands before the last stroke off the name of a metric.

    Parameters
    ----------
    name : str
        Name of a metric or of a column.

    Returns
    -------
    str
        Name of the quantity.

    Examples
    --------
    >>> base_name("unet/usgra/hd95_px_ci_low"), base_name("dsc_n")
    ('hd95_px', 'dsc_n')
    """
    return _STATISTIC.sub("", name.rpartition("/")[2])


def is_timing(name: str) -> bool:
    """Tell whether a metric or a column is a runtime, a rate, memory or a date.

    Parameters
    ----------
    name : str
        Name of a metric or of a column.

    Returns
    -------
    bool
        True for what differs every time that the same is computed.

    Examples
    --------
    >>> is_timing("training_s"), is_timing("runtime_s_median"), is_timing("images_per_s"), is_timing("lag_s")
    (True, True, True, False)
    """
    base = base_name(name)
    if base in _OF_THE_CALL:
        return True
    return _RESOURCE.search(base) is not None and _MEASURED.search(base) is None
