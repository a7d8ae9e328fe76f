"""Three sentences, which claim what the numbers of vessels and networks allow."""

from __future__ import annotations

import pandas as pd
from propagation_rows import fail, propagation_rows

from experiments.studies.propagation.comparison import correlations, pairs
from experiments.studies.propagation.findings import describe

DSC = {"reference": 1.0, "single_session": 0.7, "full": 0.8}


def sentences(cases: pd.DataFrame) -> tuple[str, ...]:
    return describe(cases, correlations(cases), pairs(cases))


def test_three_sentences_name_what_is_left_what_goes_with_it_and_what_that_shows() -> None:
    left, correlation, claim = sentences(propagation_rows(DSC))
    assert left.startswith(
        "Medians of the surface's RMSE and of the TRE after the deformable stage over 8 simulated sweeps of 8 vessels: "
        "0.2 mm and 0.68 mm with the reference masks; "
    )
    assert "full (mean DSC 0.765)" in left
    assert left.endswith("; none failed.")
    assert correlation.startswith(
        "Spearman's correlation of DSC over 16 pairs of sweep and network (8 vessels"
    )
    assert "between networks on the same sweep -1.00 (-1.00 to -1.00)" in correlation
    assert "2 paired tests of DSC and TRE after the deformable stage between configurations" in claim
    assert "TRE after the deformable stage of full below that of single_session by 0.50 mm" in claim
    assert "DSC of single_session below that of full by 0.100" in claim
    assert "with 1 network a configuration" in claim
    assert claim.endswith("all sweeps are simulated, not comparable, and no value was published.")


def test_failures_and_few_vessels_are_stated() -> None:
    few = propagation_rows(DSC, vessels=3)
    left, correlation, claim = sentences(fail(few, "full", 1001))
    assert "1 of 9 surfaces and 1 of 9 registrations failed and rank worst" in left
    assert "no interval" in correlation
    assert "no difference shown; of the others 2 had too few vessels to show any" in claim
    lost = few
    for sweep in (1000, 1001, 1002):
        lost = fail(lost, "full", sweep)
    assert "none, as 3 of 3 failed, with full" in sentences(lost)[0]


def test_smoke_and_single_configurations_are_compared_with_nothing() -> None:
    note, *_, claim = sentences(propagation_rows(DSC, model="smoke-trained unet"))
    assert note.startswith("trainer=smoke shows that all works")
    assert "smoke-trained networks are compared with nothing; all sweeps are simulated" in claim
    assert "a single configuration is compared with nothing" in sentences(propagation_rows({"full": 0.8}))[-1]
    alone = sentences(propagation_rows({"reference": 1.0}))
    assert alone[1].startswith("DSC is correlated with nothing")


def test_the_configuration_that_is_below_is_named_also_where_the_other_failed() -> None:
    cases = propagation_rows({"full": 0.7, "full_as_pruned": 0.8})
    for sweep in range(1000, 1006):
        cases = fail(cases, "full", sweep)
    claim = sentences(cases)[-1]
    assert (
        "TRE after the deformable stage of full_as_pruned below that of full, which failed on half of the vessels or "
        "more" in claim
    )
    assert "DSC of full below that of full_as_pruned by 0." in claim
