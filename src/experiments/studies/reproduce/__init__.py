"""Study ``reproduce``: a tracked run, run again from its id in an empty store, and compared number by number."""

from experiments.studies.reproduce.study import TRACKED, check, run

__all__ = ["TRACKED", "check", "run"]
