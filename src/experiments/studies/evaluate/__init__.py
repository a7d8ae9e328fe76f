"""Anyone's masks or transforms, scored as the studies score their own."""

from experiments.studies.evaluate.study import check, implicit_paths, run

__all__ = ["check", "implicit_paths", "run"]
