"""Study ``runtime``: how long each stage from acquisition to registration takes, and how much memory, by phantom."""

from experiments.studies.runtime.measured import measured
from experiments.studies.runtime.study import check, jobs, run, summarise

__all__ = ["check", "jobs", "measured", "run", "summarise"]
