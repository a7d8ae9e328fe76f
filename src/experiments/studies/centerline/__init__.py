"""Study ``centerline``: the centerline of a vessel whose surface or cloud the user has."""

from experiments.studies.centerline.study import check, run

__all__ = ["check", "run"]
