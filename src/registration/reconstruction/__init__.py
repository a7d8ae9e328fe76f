"""Masks to a cloud of contour points, and the cloud to a surface."""
