"""Study ``report``: published values beside measured ones, every table and figure, and one page, from tracked runs."""

from experiments.studies.report.study import TRACKED, run

__all__ = ["TRACKED", "run"]
