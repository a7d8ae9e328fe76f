"""How often a rigid method finds a known pose again, over rotations, overlap, noise, outliers and lost frames."""

from experiments.studies.robustness.measured import measured
from experiments.studies.robustness.study import (
    HEADLINE,
    check,
    jobs,
    over_repeats,
    parameters,
    run,
    summarise,
)

__all__ = ["HEADLINE", "check", "jobs", "measured", "over_repeats", "parameters", "run", "summarise"]
