"""Groups of trials in their order, and conditions that never mix."""

from __future__ import annotations

import pandas as pd
from robustness_rows import row

from experiments.studies.robustness.grouping import by_condition, crossed, groups, methods, with_condition


def test_groups_keep_their_order_and_levels_that_are_no_number() -> None:
    cases = pd.DataFrame([row("b"), row("a"), row("b", factor="noise_mm", level=0.5)])
    assert methods(cases) == ["b", "a"]
    assert [(key[0], len(group)) for key, group in groups(cases, ("method", "level"))] == [
        ("b", 1),
        ("a", 1),
        ("b", 1),
    ]
    assert len(crossed(cases)) == 2


def test_trials_are_split_by_condition_where_they_have_one() -> None:
    alone = pd.DataFrame([row("a"), row("b")])
    assert with_condition(alone, ("method",)) == ("method",)
    assert [(name, len(part)) for name, part in by_condition(alone)] == [("", 2)]
    two = pd.concat([alone.assign(condition="noise_mm=1"), alone.assign(condition="noise_mm=0")])
    assert with_condition(two, ("method",)) == ("condition", "method")
    assert [(name, len(part)) for name, part in by_condition(two)] == [("noise_mm=1", 2), ("noise_mm=0", 2)]
