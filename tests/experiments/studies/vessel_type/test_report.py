"""Cases by what they were trained and tested on, with known gains of vessels and of aggregation."""

from __future__ import annotations

from typing import Any

import pandas as pd
import pytest
from vessel_type_results import cases, results

from experiments.studies.vessel_type.report import by_condition, published_of, summary_of


def test_networks_of_their_own_district_count_for_both_where_there_are_some_of_each() -> None:
    every = pd.concat([result.cases for result in results() if result.cases is not None])
    shown = by_condition(every)
    counts = shown.groupby(["vessel", "trained_on", "tested_on"]).size().unique().tolist()
    assert sorted(counts) == [40, 80]
    assert shown.groupby(["trained_on", "tested_on"]).ngroups == 6
    alone = by_condition(every[every["trained_on"] != "femoral"])
    assert ("own district", "both districts") not in set(
        zip(alone["trained_on"], alone["tested_on"], strict=True)
    )


def test_where_no_district_is_known_there_are_both_together_alone() -> None:
    unknown = cases("artery", "aggregated").assign(district="")
    assert set(by_condition(unknown)["tested_on"]) == {"both districts"}


def test_pairs_show_what_helps_arteries_and_harms_veins() -> None:
    outcome = summary_of(results())
    pairs = outcome.tables["comparison of training and of vessels"].set_index(["dataset", "metric", "models"])
    training = "own district - aggregated"
    for tested in ("carotid", "femoral", "both districts"):
        artery = pairs.loc[(f"unseen cases, artery, {tested}, unet", "dsc", training)]
        vein = pairs.loc[(f"unseen cases, vein, {tested}, unet", "dsc", training)]
        assert artery["verdict"] == "aggregated better" and artery["mean_difference"].startswith("-0.050")
        assert vein["verdict"] == "own district better" and vein["mean_difference"].startswith("+0.100")
    vessels = pairs.loc[("unseen cases, both districts, aggregated, unet", "dsc", "artery - vein")]
    assert vessels["verdict"] == "artery better" and vessels["mean_difference"].startswith("+0.350")


def test_the_published_values_stand_at_aggregated_training_and_both_districts() -> None:
    table = summary_of(results()).tables["vessel types"].set_index(["vessel", "trained_on", "tested_on"])
    published = {key: value for key, value in table["published"].items() if value}
    assert published == {
        ("artery", "aggregated", "both districts"): "89.8 to 91.2 %",
        ("vein", "aggregated", "both districts"): "58.4 to 72.1 %",
    }
    of: dict[str, Any] = {"vessel": "vein", "tested_on": "both districts", "model": "unet"}
    assert published_of({**of, "trained_on": "own district"}) == ()


@pytest.mark.parametrize(
    ("known", "said"),
    [
        ({"simulated": True}, "simulated, not comparable"),
        ({"data": "subject leakage possible"}, "subject leakage possible"),
        ({}, ""),
    ],
)
def test_every_row_says_what_its_data_are(known: dict[str, Any], said: str) -> None:
    outcome = summary_of(results(trained=("aggregated",), **known))
    assert set(outcome.tables["vessel types"]["data"]) == {said}
    assert all(said in sentence for sentence in outcome.findings if "mean DSC" in sentence)
    assert set(outcome.figures) == {"vessel_types"}
