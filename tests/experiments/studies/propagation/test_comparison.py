"""Correlations and paired tests on made-up rows, whose relation is known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from propagation_rows import fail, propagation_rows

from experiments.studies.propagation.comparison import NO_DIFFERENCE, TOO_FEW, correlations, pairs

DSC = {"reference": 1.0, "single_session": 0.7, "full": 0.8, "pruned": 0.85}


def of(table: pd.DataFrame, **place: str) -> pd.Series:
    rows = table
    for name, value in place.items():
        rows = rows[rows[name] == value]
    assert len(rows) == 1
    return rows.iloc[0]


def test_a_lower_dsc_goes_with_a_larger_error_and_the_reference_is_no_network() -> None:
    found = correlations(propagation_rows(DSC))
    together = of(found, masks="dsc", error="surface_rmse_mm", over="all")
    assert (together["n"], together["vessels"]) == (24, 8)
    assert together["rho"] == pytest.approx(-1.0)
    assert of(found, masks="hd95_mm", error="surface_rmse_mm", over="all")["rho"] == pytest.approx(1.0)
    # What a vessel adds of its own hides a part of it, but not on the same sweep.
    hidden = of(found, masks="dsc", error="tre_mm", over="all")
    assert -1.0 < hidden["rho"] < 0.0
    assert hidden["low"] <= hidden["rho"] <= hidden["high"]
    assert of(found, masks="dsc", error="tre_mm", over="same sweep")["rho"] == pytest.approx(-1.0)
    assert set(found["over"]) == {"all", "same sweep", "single_session", "full", "pruned"}
    assert of(found, masks="dsc", error="tre_mm", over="full")["n"] == 8


def test_folds_of_a_network_are_no_further_vessels() -> None:
    found = correlations(propagation_rows(DSC, folds=3))
    row = of(found, masks="dsc", error="tre_mm", over="all")
    assert (row["n"], row["vessels"]) == (72, 8)


def test_without_a_deformable_stage_or_networks_nothing_is_made_up() -> None:
    assert "deformed_tre_mm" not in set(correlations(propagation_rows(DSC, deformed=False))["error"])
    alone = propagation_rows({"reference": 1.0})
    assert correlations(alone).empty
    assert pairs(alone).empty
    single = correlations(propagation_rows({"reference": 1.0, "full": 0.8}))
    assert set(single["over"]) == {"all"}


def test_a_configuration_that_leaves_less_on_every_vessel_is_found() -> None:
    found = pairs(propagation_rows(DSC))
    row = of(found, measure="tre_mm", first="single_session", second="full")
    assert row["median_difference"] == pytest.approx(1.0)
    assert row["p"] == pytest.approx(2 / 2**8)
    assert row["p_holm"] == pytest.approx(3 * 2 / 2**8)
    assert row["verdict"] == "full lower"
    assert (
        of(found, measure="dsc", first="single_session", second="full")["verdict"] == "single_session lower"
    )
    assert set(found["vessels"]) == {8}


def test_few_vessels_claim_nothing() -> None:
    found = pairs(propagation_rows(DSC, vessels=5))
    assert set(found["verdict"]) == {TOO_FEW}
    assert (found["p_holm"] > 0.05).all()
    same = propagation_rows({"full": 0.8, "pruned": 0.8}, vessels=10)
    # Now the one is ahead, now the other.
    same.loc[10:, "tre_mm"] += [0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7, -0.8, 0.9, -1.0]
    assert of(pairs(same), measure="tre_mm")["verdict"] == NO_DIFFERENCE


def test_a_failure_ranks_worst_and_leaves_no_number() -> None:
    cases = fail(propagation_rows({"full": 0.8, "pruned": 0.85}), "pruned", 1007)
    row = of(pairs(cases), measure="tre_mm")
    assert row["p"] > 2 / 2**8
    assert row["high"] < np.inf
    together = of(correlations(cases), masks="dsc", error="tre_mm", over="all")
    assert together["n"] == 16
    assert together["rho"] < 0


def test_smoke_trained_networks_are_compared_with_nothing_but_their_masks_count() -> None:
    cases = propagation_rows(DSC, model="smoke-trained unet")
    assert pairs(cases).empty
    assert len(correlations(cases))


def test_several_networks_of_a_configuration_are_compared_each_for_itself() -> None:
    both = pd.concat(
        [propagation_rows({"full": 0.8, "pruned": 0.85}, model=name) for name in ("unet", "attention_unet")]
    )
    found = pairs(both)
    assert found.groupby("model").size().to_dict() == {"attention_unet": 5, "unet": 5}
    scopes = set(correlations(both)["over"])
    assert {"full, unet", "pruned, attention_unet", "same sweep"} <= scopes
