"""Study ``checklist``: reporting checklists filled from tracked runs, with what no run can tell listed as missing."""

from experiments.studies.checklist.study import TRACKED, run

__all__ = ["TRACKED", "run"]
