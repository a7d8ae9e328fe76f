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

# What known sweeps show. When it changes, entries of before are outdated: raise CACHE_VERSION and change the version
# and the numbers here together.
SIMULATED_BY = 1
SIMULATED = {
    "": [55.36, 52.74, 32.94, 48.19, 28.86, 2019, 29, 0],
    "carotid": [50.48, 50.65, 33.97, 52.75, 33.49, 1905, 109, 34],
    "femoral": [50.07, 53.20, 31.71, 46.52, 30.86, 1878, 96, 74],
}


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
    monkeypatch.setattr(sweep_cache, "CACHE_VERSION", sweep_cache.CACHE_VERSION + 1)
    assert not {sweep_hash(recipe) for recipe in recipes} & set(before)


def test_frames_do_not_change_without_the_version(tmp_path) -> None:
    """Means of quarters of a frame and areas of its labels: rounding on other machines leaves them as they are."""
    shown = {}
    for district in ("", "carotid", "femoral"):
        images, masks = labelled_sweep(SweepRecipe(SETTINGS, 0, district), tmp_path)
        quarters = images[1].reshape(2, 16, 2, 16).mean(axis=(1, 3)).ravel()
        shown[district] = [*quarters, images.std(), *np.bincount(masks.ravel(), minlength=3)]
    assert sweep_cache.CACHE_VERSION == SIMULATED_BY
    for district, expected in SIMULATED.items():
        np.testing.assert_allclose(shown[district], expected, atol=0.3)


def test_a_folder_that_keeps_nothing_is_named(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep_cache, "fill_cache", lambda *_: None)
    with pytest.raises(InputError, match="cache: expected a folder that keeps what is written to it"):
        labelled_sweep(SweepRecipe(SETTINGS, 0), tmp_path)
