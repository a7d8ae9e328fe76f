"""Data sets of labelled frames, read from files or simulated."""
