"""Study ``consistency``: repeated sweeps of a phantom, reconstructed, compared with each other and with the truth."""

from experiments.studies.consistency.measured import measured
from experiments.studies.consistency.study import HEADLINE, check, jobs, parameters, run, summarise

__all__ = ["HEADLINE", "check", "jobs", "measured", "parameters", "run", "summarise"]
