"""Readers of meshes and clouds, one module a format: each gives points and the corners of the polygons between them."""
