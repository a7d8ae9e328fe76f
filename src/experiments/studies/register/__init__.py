"""Rigid registration of two files of a user's own."""

from experiments.studies.register.study import check, run

__all__ = ["check", "run"]
