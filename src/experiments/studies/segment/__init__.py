"""Study ``segment``: vessel masks of anyone's images, videos and sweeps, by a saved model."""

from experiments.studies.segment.study import TRACKED, check, run

__all__ = ["TRACKED", "check", "run"]
