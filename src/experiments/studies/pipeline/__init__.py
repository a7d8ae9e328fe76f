"""Study ``pipeline``: one simulated sweep from its frames to the registered vessel, each stage timed and measured."""

from experiments.studies.pipeline.study import HEADLINE, check, run

__all__ = ["HEADLINE", "check", "run"]
