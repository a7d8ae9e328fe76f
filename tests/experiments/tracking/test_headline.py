"""Few metrics, curves of the same names, and a description that the tracker takes."""

from __future__ import annotations

import json
import math

from experiments.tracking.headline import (
    LONGEST_NOTE,
    MOST_METRICS,
    curves,
    description,
    headline,
    metrics_text,
    without_figures,
)


def test_the_studys_own_choice_comes_in_its_order_and_without_what_is_not_there() -> None:
    metrics = {"dsc_mean": 0.9, "dsc_n": 20.0, "hd95_mm_mean": 1.0}
    assert list(headline(metrics, ["hd95_mm_mean", "tre_mm", "dsc_mean"])) == ["hd95_mm_mean", "dsc_mean"]


def test_without_a_choice_the_first_few_are_taken() -> None:
    metrics = {f"m{number}": float(number) for number in range(50)}
    assert list(headline(metrics)) == list(metrics)[:MOST_METRICS]
    assert list(headline({"a": 1.0}, ["b"])) == ["a"]
    assert list(headline({**metrics, "tre_mm": 1.0, "dsc_mean": 0.5}))[:3] == ["dsc_mean", "tre_mm", "m0"]


def test_an_infinite_metric_stays_so_that_the_tracker_counts_a_failure() -> None:
    assert headline({"tre_mm_mean": math.inf}, ["tre_mm_mean"]) == {"tre_mm_mean": math.inf}


def test_curves_are_losses_and_scores_under_one_name_each() -> None:
    epoch = {"train_loss": 1.0, "validation_loss": 2.0, "validation_dsc": 0.5, "learning_rate": 0.1}
    epoch |= {"images_per_s": 3.0, "peak_memory_mb": 4.0, "distillation_loss": 5.0}
    assert curves([epoch]) == (
        {"train_loss": 1.0, "val_loss": 2.0, "val_dsc": 0.5, "distillation_loss": 5.0},
    )


def test_a_description_holds_tables_then_findings() -> None:
    assert description(["It is right."], "| a |\n| --- |\n") == "| a |\n| --- |\n\n- It is right."
    assert description([], "") == ""


def test_figures_end_a_description_and_are_left_out_of_a_copy() -> None:
    text = description(["It is right."], "| a |", ["success curve", "b", "c", "d", "e"], "0123")
    shown = "![success curve](get-artifact?path=success%20curve.png&run_uuid=0123)"
    assert text.startswith(f"| a |\n\n- It is right.\n\n{shown}")
    assert text.count("get-artifact") == 4
    assert without_figures(text) == "| a |\n\n- It is right."
    long = description([], "| x |\n" * 4000, ["b"], "0123")
    assert len(long) <= LONGEST_NOTE and long.endswith("![b](get-artifact?path=b.png&run_uuid=0123)")


def test_a_long_description_is_cut_between_lines_and_says_where_the_rest_is() -> None:
    rows = "\n".join(f"| {number} | {'x' * 80} |" for number in range(400))
    text = description(["lost"], rows)
    assert len(text) <= LONGEST_NOTE and "summary.md" in text and "lost" not in text
    *kept, _, _ = text.splitlines()
    assert all(line.startswith("| ") and line.endswith(" |") for line in kept)


def test_metrics_that_are_no_numbers_survive_in_the_file() -> None:
    read = json.loads(metrics_text({"a": math.nan, "b": -math.inf, "c": 0.1}))
    assert math.isnan(float(read["a"])) and float(read["b"]) == -math.inf and read["c"] == 0.1
