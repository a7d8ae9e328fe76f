"""Centerlines of vessels: ordered lines with a radius at every point."""

from registration.centerline.extractor import CAP_RINGS, TOGETHER_RADII, CenterlineExtractor

__all__ = ["CAP_RINGS", "TOGETHER_RADII", "CenterlineExtractor"]
