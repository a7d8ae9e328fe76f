"""Rigid registration of two files of a user's own."""

from experiments.studies.register.study import HEADLINE, check, implicit_paths, run

__all__ = ["HEADLINE", "check", "implicit_paths", "run"]
