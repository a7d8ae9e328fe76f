"""One model from the folds: averages, ensembles and a distilled network compared, calibrated, and certified."""

from experiments.studies.consolidation.study import HEADLINE, check, jobs, over_repeats, run, summarise

__all__ = ["HEADLINE", "check", "jobs", "over_repeats", "run", "summarise"]
