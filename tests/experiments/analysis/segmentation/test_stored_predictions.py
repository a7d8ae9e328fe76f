"""Predictions survive their file: logits to half a step, masks exactly, sizes and parts as they were."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from experiments.analysis.segmentation.stored_predictions import StoredMasks, StoredPredictions, writing
from experiments.errors import InputError
from models.evaluation import CasePrediction
from models.preprocessing.preprocessing import Preprocessing

PREPROCESSING = Preprocessing(32)
SIZES = {"wide/1": (20, 64), "tall": (48, 24)}


def prediction(case: str, seed: int) -> CasePrediction:
    rng = np.random.default_rng(seed)
    logits = rng.normal(0, 8, (32, 32)).astype(np.float32)
    return CasePrediction(case, logits, PREPROCESSING.placement(*SIZES[case]), rng.random(SIZES[case]) < 0.5)


@pytest.fixture
def stored(tmp_path: Path) -> StoredPredictions:
    with writing(tmp_path / "predictions.zip", PREPROCESSING, model="unet", fold=1, outer_fold=None) as keep:
        keep.add(prediction("wide/1", 1), "g1", "out_of_fold")
        keep.add(prediction("tall", 2), "010", "held_out")
        assert not (tmp_path / "predictions.zip").exists()
    return StoredPredictions.open(tmp_path / "predictions.zip")


def test_logits_and_masks_are_those_that_were_added(stored: StoredPredictions) -> None:
    for seed, case in enumerate(SIZES, 1):
        given, found = prediction(case, seed), stored.logits(case)
        window = given.placement.window
        np.testing.assert_allclose(found[window], given.logits[window], atol=1 / 128)
        outside = np.ones_like(found, dtype=bool)
        outside[window] = False
        assert np.isneginf(found[outside]).all() and outside.any()
        assert np.array_equal(stored.mask(case), given.mask)
        assert stored.probability(case).shape == SIZES[case]


def test_probability_is_that_of_the_logits_at_native_size(tmp_path: Path) -> None:
    # A vertical edge: left half surely vessel, right half surely not.
    logits = np.where(np.arange(32) < 16, 12.0, -12.0).astype(np.float32) * np.ones((32, 1), np.float32)
    placement = PREPROCESSING.placement(64, 64)
    with writing(tmp_path / "a.zip", PREPROCESSING) as keep:
        keep.add(CasePrediction("edge", logits, placement, np.zeros((64, 64), bool)), "g", "out_of_fold")
    found = StoredPredictions.open(tmp_path / "a.zip").probability("edge")
    assert found.shape == (64, 64) and (found[:, :31] > 0.99).all() and (found[:, 33:] < 0.01).all()


def test_extreme_logits_stay_finite_and_on_their_side(tmp_path: Path) -> None:
    logits = np.full((32, 32), np.inf, np.float32)
    logits[:16] = -np.inf
    with writing(tmp_path / "a.zip", PREPROCESSING) as keep:
        keep.add(
            CasePrediction("a", logits, PREPROCESSING.placement(32, 32), np.ones((32, 32), bool)),
            "g",
            "selection",
        )
    found = StoredPredictions.open(tmp_path / "a.zip").logits("a")
    assert (found[:16] < -500).all() and (found[16:] > 500).all()


def test_the_index_names_parts_groups_and_the_run(stored: StoredPredictions) -> None:
    assert stored.of("out_of_fold") == ("wide/1",) and stored.of("held_out") == ("tall",)
    assert stored.cases["tall"]["group"] == "010"
    assert (
        stored.about["model"] == "unet" and stored.about["fold"] == 1 and stored.about["outer_fold"] is None
    )
    assert stored.preprocessing == PREPROCESSING
    masks = StoredMasks(stored)
    assert list(masks) == list(SIZES) and np.array_equal(masks["tall"], stored.mask("tall"))


def test_what_is_no_such_file_is_refused(tmp_path: Path, stored: StoredPredictions) -> None:
    with pytest.raises(InputError, match="expected predictions of case 'other', found none"):
        stored.mask("other")
    with pytest.raises(InputError, match="expected predictions of study=segmentation, received none"):
        StoredPredictions.open(tmp_path / "none.zip")
    with zipfile.ZipFile(tmp_path / "later.zip", "w") as archive:
        archive.writestr("index.json", json.dumps({"format": "ctus-predictions", "version": 9, "cases": []}))
    with pytest.raises(InputError, match="version 9"):
        StoredPredictions.open(tmp_path / "later.zip")


def test_a_failure_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(KeyError), writing(tmp_path / "a.zip", PREPROCESSING) as keep:
        keep.add(prediction("tall", 0), "g", "out_of_fold")
        raise KeyError
    assert list(tmp_path.iterdir()) == []
