"""Rigid registration of two files of a user's own."""

from experiments.studies.register.study import HEADLINE, check, implicit_paths, run
from experiments.studies.register.summary import summarise

__all__ = ["HEADLINE", "check", "implicit_paths", "run", "summarise"]
