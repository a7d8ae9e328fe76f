"""Metrics of binary masks."""

from models.metrics.masks import (
    Directed,
    Spacing,
    diagonal,
    dsc,
    hd95_mm,
    hd95_pooled_mm,
    hd95_px,
    hd95_surfel_mm,
)

__all__ = ["Directed", "Spacing", "diagonal", "dsc", "hd95_mm", "hd95_pooled_mm", "hd95_px", "hd95_surfel_mm"]
