"""Pre-processing of ultrasound frames, the same in training and inference."""

from models.preprocessing.preprocessing import (
    HALF_LEVEL,
    NORMALISATIONS,
    OVERLAYS,
    SECTORS,
    Placement,
    Preprocessing,
)

__all__ = ["HALF_LEVEL", "NORMALISATIONS", "OVERLAYS", "SECTORS", "Placement", "Preprocessing"]
