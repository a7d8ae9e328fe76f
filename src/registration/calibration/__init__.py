"""Temporal and spatial calibration of a tracked probe, and of a stylus."""
