"""The decision between one network and the ensemble, on scores whose differences are known."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import pytest

from experiments.analysis.consolidation.candidates import DISTILLED, ENSEMBLE, GREEDY, UNIFORM
from experiments.analysis.consolidation.certificate import NonInferiority, page
from experiments.errors import InputError


def scored(
    gains: Mapping[str, float | list[float]], *, groups: int = 12, seeds: int = 3, images: int = 2
) -> pd.DataFrame:
    """Rows of selection cases; a candidate's DSC is the ensemble's plus its gain (in each group, or one for all)."""
    base = np.random.default_rng(0).uniform(0.6, 0.8, (groups, images))
    rows = []
    for name, gain in {ENSEMBLE: 0.0, **gains}.items():
        for seed in range(seeds):
            for (group, image), dsc in np.ndenumerate(base):
                own = gain[group] if isinstance(gain, list) else gain
                rows.append(
                    {
                        "model": name,
                        "seed": seed,
                        "fold": -1,
                        "group": f"g{group}",
                        "case_id": f"{group}-{image}",
                        "dsc": dsc + own + 0.001 * seed,
                        "missed": 0.0,
                        "false_alarm": np.nan,
                    }
                )
    return pd.DataFrame(rows)


def test_an_average_within_the_margin_becomes_the_model() -> None:
    found = NonInferiority()(scored({UNIFORM: -0.005, GREEDY: -0.002}))
    assert (found.consolidated, found.kind, found.certified) == (GREEDY, "averaged network", True)
    assert (found.groups, found.images, found.seeds) == (12, 24, 3)
    first = found.comparisons[0]
    assert first.difference == pytest.approx(-0.002) and first.lower_bound == pytest.approx(-0.002)
    # Two single networks share the level of 5 %.
    assert first.confidence == pytest.approx(0.975)


def test_a_distilled_network_takes_the_place_of_an_average_that_fails() -> None:
    found = NonInferiority()(scored({UNIFORM: -0.02, DISTILLED: -0.004}))
    assert (found.consolidated, found.kind, found.certified) == (DISTILLED, "distilled network", True)
    assert [each.passes for each in found.comparisons] == [False, True]


def test_an_average_that_passes_goes_before_a_better_distilled_network() -> None:
    assert NonInferiority()(scored({UNIFORM: -0.004, DISTILLED: 0.02})).consolidated == UNIFORM


def test_the_ensemble_stays_where_no_single_network_passes() -> None:
    found = NonInferiority()(scored({UNIFORM: -0.02, GREEDY: -0.03, DISTILLED: -0.015}))
    assert (found.consolidated, found.kind, found.certified) == (ENSEMBLE, ENSEMBLE, False)
    assert "no single network was shown to lose at most 0.01 DSC: uniform -0.0200" in found.reason


def test_a_mean_within_the_margin_is_not_enough_where_groups_differ() -> None:
    apart = [0.09, -0.09] * 6
    found = NonInferiority()(scored({UNIFORM: apart}))
    assert found.comparisons[0].difference == pytest.approx(0.0)
    assert found.consolidated == ENSEMBLE and found.comparisons[0].lower_bound < -0.01


def test_too_few_groups_are_said_and_fall_back_to_the_ensemble() -> None:
    found = NonInferiority()(scored({UNIFORM: 0.05}, groups=2))
    assert found.consolidated == ENSEMBLE and not found.certified
    assert found.reason.startswith("not certified: n = 2 groups")
    assert np.isnan(found.comparisons[0].lower_bound) and not found.comparisons[0].passes


def test_two_seeds_certify_nothing() -> None:
    found = NonInferiority()(scored({UNIFORM: 0.05}, seeds=2))
    assert (found.consolidated, found.certified) == (ENSEMBLE, False)
    assert found.reason == "not certified: n = 2 seeds, at least 3 are needed; the ensemble of folds is used."


def test_candidates_scored_on_other_cases_are_refused() -> None:
    cases = scored({UNIFORM: 0.0})
    with pytest.raises(InputError, match="expected uniform on the cases and seeds of the ensemble of folds"):
        NonInferiority()(cases.drop(cases[cases["model"] == UNIFORM].index[0]))
    with pytest.raises(InputError, match="expected rows of the ensemble of folds"):
        NonInferiority()(cases[cases["model"] == UNIFORM])


@pytest.mark.parametrize(
    ("name", "value"), [("margin", 0.0), ("alpha", 0.5), ("min_seeds", 0), ("min_groups", 1)]
)
def test_refuses_values_out_of_range(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"{name}: expected"):
        NonInferiority(**{name: value})


def test_the_page_says_which_why_by_how_much_and_on_whom() -> None:
    block = NonInferiority()(scored({UNIFORM: -0.004, DISTILLED: -0.02})).block(
        data=[{"name": "usgra", "digest": "abc", "licence": "CC BY 4.0"}]
    )
    text = page(block)
    for part in (
        "Model: **uniform** (averaged network), certified.",
        "24 images with a vessel of 12 selection groups, 3 seeds",
        "Data: usgra, CC BY 4.0, SHA-256 `abc`.",
        "| -0.0040 | -0.0040 | 97.50 % |",
        "| distilled |",
    ):
        assert part in text
