"""The tracker: every call to MLflow that the project makes is in this package."""

from experiments.tracking.run_writer import RunWriter, ServerAwayError, ending, loggable, server_unreachable
from experiments.tracking.store import HASH_TAG, LABEL_TAG, METRICS_FILE, ORIGIN_TAG, PARENT_TAG, Store
from experiments.tracking.written import RunStart

__all__ = [
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
    "server_unreachable",
]
