"""Training of one fold: data, losses, schedule, resumable state."""

from models.training.fold import OnEpoch, TrainedFold, initial_network, train_fold

__all__ = ["OnEpoch", "TrainedFold", "initial_network", "train_fold"]
