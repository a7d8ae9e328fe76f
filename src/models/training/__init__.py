"""Training of one fold: data, losses, schedule, resumable state."""

from models.training.fold import OnEpoch, TrainedFold, train_fold
from models.training.initialisation import initial_network

__all__ = ["OnEpoch", "TrainedFold", "initial_network", "train_fold"]
