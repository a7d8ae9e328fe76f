"""The tracker: every call to MLflow that the project makes is in this package."""

from experiments.tracking.run_writer import RunWriter, ServerAwayError, ending, loggable, server_unreachable
from experiments.tracking.store import (
    CASES_FILE,
    HASH_TAG,
    LABEL_TAG,
    METRICS_FILE,
    ORIGIN_TAG,
    PARENT_TAG,
    Store,
    origin_of,
)
from experiments.tracking.written import RunStart

__all__ = [
    "CASES_FILE",
    "HASH_TAG",
    "LABEL_TAG",
    "METRICS_FILE",
    "ORIGIN_TAG",
    "PARENT_TAG",
    "RunStart",
    "RunWriter",
    "ServerAwayError",
    "Store",
    "ending",
    "loggable",
    "origin_of",
    "server_unreachable",
]
