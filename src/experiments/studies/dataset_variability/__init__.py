"""What the variety of a data set, and not its size alone, does to segmentation: configurations of San Raffaele."""

from experiments.studies.dataset_variability.measured import measured
from experiments.studies.dataset_variability.study import check, jobs, run, summarise

__all__ = ["check", "jobs", "measured", "run", "summarise"]
