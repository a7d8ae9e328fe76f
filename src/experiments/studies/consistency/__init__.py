"""Study ``consistency``: repeated sweeps of a phantom, reconstructed, compared with each other and with the truth."""

from experiments.studies.consistency.study import check, jobs, run, summarise

__all__ = ["check", "jobs", "run", "summarise"]
