"""Study ``ct_model``: the preoperative side, from a label map or a mesh of the user's to surface and centerline."""

from experiments.studies.ct_model.study import check, run

__all__ = ["check", "run"]
