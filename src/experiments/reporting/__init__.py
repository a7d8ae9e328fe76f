"""Scenes, figures and pages of results."""
