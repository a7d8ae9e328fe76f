"""Sweeps kept on disk: one entry for each recipe, with labels where there are two vessels."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from experiments.datasets import sweep_cache
from experiments.datasets.sweep_cache import SweepRecipe, labelled_sweep, sweep_hash
from experiments.errors import InputError
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Motion
from registration.phantom.settings import PhantomSettings

SETTINGS = PhantomSettings(
    subset="random", anatomy_seed=3, scanner=Scanner(height_px=32, width_px=32), motion=Motion(frames=2)
)


def test_one_vessel_gives_bool_masks_and_two_give_labels(tmp_path) -> None:
    _, one = labelled_sweep(SweepRecipe(SETTINGS, 0), tmp_path)
    images, two = labelled_sweep(SweepRecipe(SETTINGS, 0, "femoral"), tmp_path)
    assert one.dtype == bool and two.dtype == np.uint8
    assert images.shape == two.shape == (2, 32, 32) and set(np.unique(two)) == {0, 1, 2}


def test_every_part_of_a_recipe_has_its_own_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    recipes = [
        SweepRecipe(SETTINGS, 0),
        SweepRecipe(SETTINGS, 1),
        SweepRecipe(SETTINGS, 0, "carotid"),
        SweepRecipe(SETTINGS, 0, "femoral"),
        SweepRecipe(dataclasses.replace(SETTINGS, anatomy_seed=4), 0),
    ]
    assert len({sweep_hash(recipe) for recipe in recipes}) == 5
    before = [sweep_hash(recipe) for recipe in recipes]
    monkeypatch.setattr(sweep_cache, "_pair_source", lambda: "changed")
    after = [sweep_hash(recipe) for recipe in recipes]
    assert [one == other for one, other in zip(before, after, strict=True)] == [
        True,
        True,
        False,
        False,
        True,
    ]


def test_a_folder_that_keeps_nothing_is_named(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep_cache, "fill_cache", lambda *_: None)
    with pytest.raises(InputError, match="cache: expected a folder that keeps what is written to it"):
        labelled_sweep(SweepRecipe(SETTINGS, 0), tmp_path)
