"""Rigid registration of two files of a user's own."""

from experiments.studies.register.study import check, implicit_paths, run

__all__ = ["check", "implicit_paths", "run"]
