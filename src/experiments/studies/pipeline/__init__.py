"""Study ``pipeline``: one simulated sweep from its frames to the registered vessel, each stage timed and measured."""

from experiments.studies.pipeline.study import check, run

__all__ = ["check", "run"]
