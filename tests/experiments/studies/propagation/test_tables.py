"""Tables of made-up rows: what is counted, and that every row says that it is simulated."""

from __future__ import annotations

import numpy as np
import pandas as pd
from propagation_rows import fail, propagation_rows

from experiments.studies.propagation.comparison import correlations, pairs
from experiments.studies.propagation.tables import last_error, median_of, tables, things

DSC = {"reference": 1.0, "full": 0.8, "pruned": 0.85}


def made(cases: pd.DataFrame) -> dict[str, pd.DataFrame]:
    return tables(cases, correlations(cases), pairs(cases))


def test_every_configuration_has_a_row_that_says_it_is_simulated() -> None:
    masks, errors, correlated, compared = made(propagation_rows(DSC, folds=3)).values()
    assert masks["configuration"].tolist() == errors["configuration"].tolist() == list(DSC)
    assert masks["networks"].tolist() == [0, 3, 3]
    assert masks["sweeps"].tolist() == masks["vessels"].tolist() == [8, 8, 8]
    assert masks["missed"].tolist() == ["0/400", "0/1200", "0/1200"]
    assert masks["false_alarms"].tolist() == ["0/80", "24/240", "24/240"]
    assert masks["dsc"].iloc[0] == "1.000 [1.000, 1.000]"
    for table in (masks, errors, correlated):
        assert set(table["data"]) == {"simulated, not comparable"}
    assert set(correlated["over"]) == {"all", "same sweep"}
    assert compared["configurations"].unique().tolist() == ["full - pruned"]


def test_failures_are_counted_and_no_number_hides_them() -> None:
    cases = propagation_rows(DSC, vessels=3)
    for sweep in (1000, 1001):
        cases = fail(cases, "full", sweep)
    masks, errors = list(made(cases).values())[:2]
    row = errors.set_index("configuration").loc["full"]
    assert (row["failed"], row["no_surface"]) == (2, 2)
    assert np.isinf(row["tre_mm"])
    assert row["tre<=2mm"] == "1/3"
    assert masks.set_index("configuration").loc["full", "missed"] == "100/150"


def test_the_median_ranks_failures_worst() -> None:
    assert median_of(pd.Series([1.0, 2.0, np.inf])) == 2.0
    assert median_of(pd.Series([1.0, np.inf])) == np.inf
    assert median_of(pd.Series([1.0, 3.0, np.nan])) == 2.0
    assert np.isnan(median_of(pd.Series([np.nan])))


def test_the_last_error_is_that_of_the_last_stage() -> None:
    assert last_error(propagation_rows(DSC)) == "deformed_tre_mm"
    assert last_error(propagation_rows(DSC, deformed=False)) == "tre_mm"
    assert [thing.name for thing, _ in things(propagation_rows(DSC))] == list(DSC)
