"""One model from the folds: averages, ensembles and a distilled network compared, calibrated, and certified."""

from experiments.studies.consolidation.study import check, jobs, run, summarise

__all__ = ["check", "jobs", "run", "summarise"]
