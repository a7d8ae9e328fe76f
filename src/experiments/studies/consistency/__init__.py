"""Study ``consistency``: repeated sweeps of a phantom, reconstructed, compared with each other and with the truth."""

from experiments.studies.consistency.study import cells, check, run, summarise

__all__ = ["cells", "check", "run", "summarise"]
