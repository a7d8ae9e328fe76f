"""Study ``compare``: two tracked runs or sweeps side by side, by settings, metrics and paired tests."""

from experiments.studies.compare.study import TRACKED, run

__all__ = ["TRACKED", "run"]
