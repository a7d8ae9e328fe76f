"""How often a rigid method finds a known pose again, over rotations, overlap, noise, outliers and lost frames."""

from experiments.studies.robustness.study import check, jobs, run, summarise

__all__ = ["check", "jobs", "run", "summarise"]
