"""From calibrated probability to the final mask: thresholds, morphology, and how both are chosen."""

from models.postprocessing.component_scores import SelectionCase
from models.postprocessing.components import Components, components
from models.postprocessing.hysteresis import Hysteresis
from models.postprocessing.morphology import Morphology
from models.postprocessing.options import Option, PostprocessingGrid
from models.postprocessing.selection import PostprocessingSelection, select_postprocessing

__all__ = [
    "Components",
    "Hysteresis",
    "Morphology",
    "Option",
    "PostprocessingGrid",
    "PostprocessingSelection",
    "SelectionCase",
    "components",
    "select_postprocessing",
]
