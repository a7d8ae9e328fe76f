"""Arteries against veins, and one district of the body against both together: Mus-V."""

from experiments.studies.vessel_type.measured import measured
from experiments.studies.vessel_type.study import check, jobs, run, summarise

__all__ = ["check", "jobs", "measured", "run", "summarise"]
