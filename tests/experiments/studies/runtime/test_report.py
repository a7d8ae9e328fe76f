"""Times of known stages: what is added up, what is the median, and what stands beside it."""

from __future__ import annotations

import pandas as pd
import pytest
from runtime_rows import SECONDS, costs

from experiments.studies.runtime.figure import stacked_bars
from experiments.studies.runtime.report import describe, metrics, tables, totals


def test_totals_are_of_each_repeat() -> None:
    each = totals(costs())
    assert each["total_s"].tolist() == [16.5, 16.5, 19.5]
    assert each["computing_s"].tolist() == [6.5, 6.5, 9.5]
    assert each["segmentation_frames_per_s"].tolist() == pytest.approx([20.0, 20.0, 100 / 7])
    assert each["frames_per_s"].tolist() == pytest.approx([100 / 6.5, 100 / 6.5, 100 / 9.5])
    assert each["peak_memory_mb"].tolist() == [514.0] * 3


def test_metrics_are_medians_over_the_repeats_under_each_phantoms_name() -> None:
    one = metrics(costs())
    assert (one["total_s_median"], one["segmentation_s_median"], one["total_s_n"]) == (16.5, 4.0, 3)
    both = metrics(pd.concat([costs(), costs(phantom="artery")]))
    assert both["artery/total_s_median"] == 16.5 and "total_s_median" not in both


def test_tables_have_the_spread_and_what_was_published() -> None:
    found = tables(costs())
    workflow = found["runtime of the workflow"].iloc[0]
    assert (workflow["total_s"], workflow["computing_s"]) == ("16.50 [16.50, 19.50]", "6.50 [6.50, 9.50]")
    assert workflow["without"] == ""
    assert workflow["published"] == "40 to 70 s" and workflow["data"] == "simulated, not comparable"
    stages = found["runtime by stage"].set_index("stage")
    assert list(stages.index) == ["acquisition (modelled)", *list(SECONDS)[1:]]
    assert stages.loc["segmentation", ["seconds", "lowest", "highest"]].tolist() == [4.0, 3.5, 6.0]


def test_sentences_name_the_longest_stage_and_the_published_time() -> None:
    own, public = describe(costs())
    assert (
        "vein (simulated): 16.5 s from acquisition to registration (16.50 to 19.50 s over 3 repeats)" in own
    )
    assert "the longest is segmentation, 4.00 s" in own and "segmentation: 20.0 frames/s" in own
    assert "Published: 40 to 70 s" in public and "not comparable" in public


def test_bars_are_stacked_to_the_sum_of_the_medians_with_the_published_range_beside() -> None:
    figure = stacked_bars(costs())
    (axes,) = figure.axes
    heights = [patch.get_height() for patch in axes.patches]
    assert heights == [10.0, 1.0, 4.0, 1.0, 0.5, 40.0, 30.0]
    assert axes.patches[4].get_y() == 16.0
    texts = [text.get_text() for text in axes.texts]
    assert texts == ["16.5 s", "40 to 70 s"]
    ticks = [tick.get_text() for tick in axes.get_xticklabels()]
    assert ticks == ["vein", "Published"]


def test_a_failed_stage_leaves_no_total_and_is_named() -> None:
    known = costs()
    known.loc[(known["stage"] == "rigid") & (known["repeat"] == 1), ["seconds", "error"]] = [
        float("nan"),
        "no",
    ]
    workflow = tables(known)["runtime of the workflow"].iloc[0]
    assert (workflow["total_s"], workflow["without"]) == ("", "rigid")
    own, failed, _ = describe(known)
    assert own.startswith("vein (simulated): no total, for rigid failed; 10.0 s are the modelled acquisition")
    assert "nan" not in own and failed == "vein: the stage rigid failed: no."
    assert "a stage failed" in [text.get_text() for text in stacked_bars(known).axes[0].texts]
