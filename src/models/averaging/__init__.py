"""One network from several: averages of weights, their repair, and interpolation between networks."""

from models.averaging.alignment import Alignment, WeightMatching, align_all, permuted
from models.averaging.averages import GreedyAverage, greedy_average, uniform_average
from models.averaging.batch_statistics import reestimate_batch_statistics
from models.averaging.channel_ties import ChannelTies, channel_ties
from models.averaging.interpolation import (
    BatchEvaluation,
    Evaluation,
    InterpolationPath,
    PairwiseBarriers,
    interpolation_barriers,
)
from models.averaging.members import Member, require_averageable
from models.averaging.repair import repair
from models.averaging.running import ExponentialAverage, StochasticAverage
from models.weights import Weights, weights_digest

__all__ = [
    "Alignment",
    "BatchEvaluation",
    "ChannelTies",
    "Evaluation",
    "ExponentialAverage",
    "GreedyAverage",
    "InterpolationPath",
    "Member",
    "PairwiseBarriers",
    "StochasticAverage",
    "WeightMatching",
    "Weights",
    "align_all",
    "channel_ties",
    "greedy_average",
    "interpolation_barriers",
    "permuted",
    "reestimate_batch_statistics",
    "repair",
    "require_averageable",
    "uniform_average",
    "weights_digest",
]
