"""Calibration of probabilities: temperature scaling, and measures of calibration."""

from models.calibration.reliability import ReliabilityTable, adaptive_table, equal_width_table, fine_table
from models.calibration.scores import (
    CalibrationScores,
    CalibrationStatistics,
    PixelStatistics,
    boundary_band,
    calibration_statistics,
)
from models.calibration.temperature import FittedTemperature, TemperatureScaling, fit_temperature, logits_of

__all__ = [
    "CalibrationScores",
    "CalibrationStatistics",
    "FittedTemperature",
    "PixelStatistics",
    "ReliabilityTable",
    "TemperatureScaling",
    "adaptive_table",
    "boundary_band",
    "calibration_statistics",
    "equal_width_table",
    "fine_table",
    "fit_temperature",
    "logits_of",
]
