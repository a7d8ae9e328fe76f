"""Study ``accuracy``: what is left after the rigid and after the deformable stage, on repeated simulated sweeps."""

from experiments.studies.accuracy.measured import measured
from experiments.studies.accuracy.study import HEADLINE, check, jobs, run, summarise

__all__ = ["HEADLINE", "check", "jobs", "measured", "run", "summarise"]
