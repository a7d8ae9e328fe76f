"""Streams of poses and frames: what every reader checks, and how images are decoded."""
