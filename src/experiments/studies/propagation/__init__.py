"""Study ``propagation``: what the masks of networks do to the surface and the registration of the same sweeps."""

from experiments.studies.propagation.plan import check, jobs, parameters
from experiments.studies.propagation.study import HEADLINE, over_repeats, run, summarise

__all__ = ["HEADLINE", "check", "jobs", "over_repeats", "parameters", "run", "summarise"]
