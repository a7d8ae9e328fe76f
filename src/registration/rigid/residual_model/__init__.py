"""Model of the residuals at a rigid pose: smooth displacement of the wall, error of the borders, jitter, and noise."""
