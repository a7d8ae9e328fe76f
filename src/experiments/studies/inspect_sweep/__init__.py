"""Study ``inspect_sweep``: one page on which a tracked sweep can be looked at and checked."""

from experiments.studies.inspect_sweep.study import check, run

__all__ = ["check", "run"]
