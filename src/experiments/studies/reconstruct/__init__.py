"""Study ``reconstruct``: a tracked sweep and its masks become the vessel's surface and centerline."""

from experiments.studies.reconstruct.study import check, run

__all__ = ["check", "run"]
