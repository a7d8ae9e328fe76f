"""The frozen benchmark of rigid registration: simulated sweeps of random anatomies, solved and scored."""

from experiments.studies.rigid_benchmark.study import HEADLINE, check, jobs, run, summarise

__all__ = ["HEADLINE", "check", "jobs", "run", "summarise"]
