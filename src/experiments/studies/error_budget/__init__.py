"""Study ``error_budget``: how much each source of error has a part in the true error of a registration."""

from experiments.studies.error_budget.study import check, jobs, run, summarise

__all__ = ["check", "jobs", "run", "summarise"]
