"""The table of train and test domain from drawn cases of known differences."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scored_cases import scored_cases

from experiments.errors import InputError
from experiments.statistics import Bootstrap
from experiments.studies.domain_transfer.transfer_table import describe_transfer, transfer_map, transfer_table


def transferred(loss: float = 0.3, folds: int = 3) -> pd.DataFrame:
    """Networks of two domains on both: at home each case by one fold, abroad by all of them, worse by ``loss``."""
    parts = []
    for dataset, simulated, groups in (("real", False, 8), ("phantom", True, 6)):
        home = scored_cases({"unet": 0.0}, dataset=dataset, simulated=simulated, groups=groups)
        parts.append(home.assign(train_dataset=dataset))
        other = {"real": "phantom", "phantom": "real"}[dataset]
        for fold in range(folds):
            change = (fold - (folds - 1) / 2) / 10 - loss
            parts.append(home.assign(train_dataset=other, fold=fold, dsc=home["dsc"] + change))
    return pd.concat(parts, ignore_index=True)


def test_two_by_two() -> None:
    cases = transferred()
    shown = transfer_table(cases).set_index(["trained_on", "tested_on"])
    assert set(shown.index) == {
        (one, other) for one in ("real", "phantom (simulated)") for other in ("real", "phantom (simulated)")
    }
    home, abroad = shown.loc[("real", "real")], shown.loc[("phantom (simulated)", "real")]
    assert abroad["dsc_mean"] == pytest.approx(home["dsc_mean"] - 0.3)
    # Three networks scored each case abroad: 24 cases all the same.
    assert home["cases"] == abroad["cases"] == 24 and abroad["groups"] == 8
    scores = cases[(cases["dataset"] == "real") & (cases["train_dataset"] == "real")].dropna(subset="dsc")
    expected = Bootstrap("mean_of_cases")(scores["dsc"], scores["group"].tolist())
    assert (home["dsc_ci_low"], home["dsc_ci_high"]) == (expected.low, expected.high)


def test_sentences_compare_on_the_same_cases() -> None:
    first, second = describe_transfer(transferred())
    assert first.startswith("unet tested on real: mean DSC over 8 groups ")
    assert "when trained on phantom (simulated)" in first and "mean difference -0.300" in first
    # Eight groups, all worse: 2 / 256, and two comparisons.
    assert "p = 0.0078, with Holm's adjustment 0.016, least possible p 0.0078." in first
    assert second.startswith("unet tested on phantom (simulated): mean DSC over 6 groups")
    assert "with Holm's adjustment 0.031" in second


def test_without_a_network_of_the_same_domain_nothing_is_compared() -> None:
    cases = transferred()
    sentences = describe_transfer(cases[cases["train_dataset"] == "phantom"])
    assert sentences == ()


def test_the_map_has_training_and_testing_on_one_set_on_its_diagonal() -> None:
    table = transfer_table(transferred())
    figure = transfer_map(table)
    axes = figure.axes[0]
    image = np.asarray(axes.images[0].get_array())
    assert [label.get_text() for label in axes.get_xticklabels()] == ["real", "phantom\n(simulated)"]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["real", "phantom\n(simulated)"]
    rows = table.set_index(["trained_on", "tested_on"])["dsc_mean"]
    assert image[0, 1] == rows[("real", "phantom (simulated)")] and image[0, 0] == rows[("real", "real")]
    texts = [text.get_text() for text in axes.texts]
    assert len(texts) == 4 and texts[0].startswith(f"{image[0, 0]:.3f}\n") and texts[0].endswith("8 groups")


def test_a_field_that_was_not_tried_stays_empty() -> None:
    cases = transferred()
    tried = cases[(cases["train_dataset"] == "phantom") | (cases["dataset"] == "real")]
    axes = transfer_map(transfer_table(tried)).axes[0]
    assert len(axes.texts) == 3 and np.isnan(np.asarray(axes.images[0].get_array(), dtype=float)).sum() == 1


def test_a_single_group_has_no_interval() -> None:
    cases = transferred()
    table = transfer_table(cases[cases["group"] == "g0"])
    assert table["dsc_ci_low"].isna().all()
    text = transfer_map(table).axes[0].texts[0].get_text()
    assert "nan" not in text and text.endswith("1 groups")


def test_whether_the_training_was_simulated_must_be_known() -> None:
    cases = transferred()
    only = cases[cases["dataset"] == "real"]
    with pytest.raises(InputError, match="train_simulated: expected whether 'phantom' is simulated"):
        transfer_table(only)
    told = only.assign(train_simulated=only["train_dataset"] == "phantom")
    assert set(transfer_table(told)["trained_on"]) == {"real", "phantom (simulated)"}
    with pytest.raises(InputError, match="cases: expected a column 'train_dataset'"):
        transfer_table(scored_cases({"unet": 0.0}))


def test_without_any_vessel_the_table_is_empty_and_has_its_columns() -> None:
    cases = transferred()
    cases[["dsc", "missed"]] = np.nan
    shown = transfer_table(cases)
    assert not len(shown) and {"trained_on", "tested_on", "dsc_mean"} <= set(shown)
    assert describe_transfer(cases) == ()
