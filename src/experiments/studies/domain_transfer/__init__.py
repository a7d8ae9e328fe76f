"""What a network trained on one data set is worth on another: each fold scored on the unseen cases of both."""

from experiments.studies.domain_transfer.study import (
    HEADLINE,
    check,
    jobs,
    over_repeats,
    parameters,
    run,
    summarise,
)

__all__ = ["HEADLINE", "check", "jobs", "over_repeats", "parameters", "run", "summarise"]
