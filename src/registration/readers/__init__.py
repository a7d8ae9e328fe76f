"""Readers of recorded and live sweeps."""
