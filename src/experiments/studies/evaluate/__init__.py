"""Anyone's masks or transforms, scored as the studies score their own."""

from experiments.studies.evaluate.study import check, run

__all__ = ["check", "run"]
