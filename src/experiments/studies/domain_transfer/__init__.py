"""What a network trained on one data set is worth on another: each fold scored on the unseen cases of both."""

from experiments.studies.domain_transfer.study import check, jobs, run, summarise

__all__ = ["check", "jobs", "run", "summarise"]
