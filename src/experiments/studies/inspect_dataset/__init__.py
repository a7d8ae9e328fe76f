"""Study ``inspect_dataset``: what a data set holds, whether its groups keep alike images together, and how it looks."""

from experiments.studies.inspect_dataset.study import check, run

__all__ = ["check", "run"]
