"""The frozen benchmark of rigid registration: simulated sweeps of random anatomies, solved and scored."""

from experiments.studies.rigid_benchmark.study import cells, check, run, summarise

__all__ = ["cells", "check", "run", "summarise"]
