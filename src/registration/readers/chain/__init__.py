"""Chains of transforms between named coordinate frames."""
