"""Files of surfaces, centerlines, point clouds, volumes, transforms and landmarks."""
