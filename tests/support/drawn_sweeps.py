"""A stand-in for the simulator itself: frames drawn in no time, for tests of what is made of them."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.datasets.sweep_cache import SweepRecipe


class DrawnMaker:
    """Speckle that the recipe decides, a vein (label 1) above an artery (label 2), or one vessel alone."""

    def __init__(self, recipe: SweepRecipe) -> None:
        self.recipe = recipe

    def view(self, frame: int) -> int:
        """The frame's own number."""
        return frame

    def frame(self, frame: int, view: int) -> tuple[np.ndarray, np.ndarray, None]:
        """Picture, mask or labels, nothing hidden."""
        assert frame == view
        _, height, width = self.recipe.shape
        seed = [int(self.recipe.settings.digest()[:8], 16), self.recipe.number, frame]
        picture = np.random.default_rng(seed).integers(20, 120, (height, width)).astype(np.uint8)
        labels = np.zeros((height, width), np.uint8)
        labels[2:5, 3:9] = 1
        if self.recipe.district:
            labels[8:12, 4:7] = 2
        return picture, labels if self.recipe.district else labels > 0, None


def draw_sweeps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have every sweep drawn instead of simulated for the rest of a test."""
    monkeypatch.setattr(SweepRecipe, "maker", lambda recipe: DrawnMaker(recipe))
