"""What the figures show of drawn cases: boxes where they belong, dots that are groups, axes with their units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from drawn_vessels import drawn_frames
from scored_cases import scored_cases

from experiments.analysis.segmentation.figures import overlays, spread, training_curves
from experiments.outcome import JobResult
from experiments.reporting.figure_files import save_figure
from experiments.studies.segmentation import summarise

BOTH = pd.concat(
    [
        scored_cases({"unet": 0.0, "other": 0.1}, simulated=True, spacing_mm=0.5),
        scored_cases({"unet": 0.0, "other": 0.1}, dataset="y"),
    ],
    ignore_index=True,
)


def test_a_row_for_each_data_set_and_a_column_for_each_score() -> None:
    figure = spread(BOTH)
    assert [(axes.get_title(), axes.get_ylabel()) for axes in figure.axes] == [
        ("x (simulated)", "DSC"),
        ("x (simulated)", "HD95 (mm)"),
        ("y", "DSC"),
        ("y", "HD95 (px)"),
    ]
    for axes in figure.axes:
        assert [label.get_text() for label in axes.get_xticklabels()] == ["U-Net", "other"]
        assert len(axes.patches) == 6  # two models, three folds
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["Fold 0", "Fold 1", "Fold 2"]


def test_dots_are_the_means_of_groups() -> None:
    axes = spread(BOTH).axes[0]
    dots = [line for line in axes.lines if line.get_marker() == "o"]
    shown = sorted(value for line in dots for value in line.get_ydata())
    means = BOTH[BOTH["dataset"] == "x"].groupby(["model", "group"])["dsc"].mean()
    assert shown == pytest.approx(sorted(means))


def test_boxes_stand_on_the_quartiles_and_failures_stay_in_sight() -> None:
    cases = scored_cases({"unet": 0.0}, folds=1, groups=10)
    lost = cases["case_id"] == "x-0-0"
    cases.loc[lost, ["dsc", "hd95_px"]] = [0.0, 600.0]
    dsc, distance = spread(cases).axes
    heights = dsc.patches[0].get_path().vertices[:, 1]
    quartiles = np.percentile(cases["dsc"].dropna(), [25, 75])
    assert (heights.min(), heights.max()) == pytest.approx(tuple(quartiles))
    assert dsc.get_ylim()[0] < 0 and distance.get_ylim()[1] > 600


def test_a_model_without_a_fold_leaves_its_place_empty() -> None:
    cases = scored_cases({"unet": 0.0, "other": 0.1})
    partly = cases[~((cases["model"] == "other") & (cases["fold"] == 1))]
    assert len(spread(partly).axes[0].patches) == 5


def test_seeds_make_no_further_cases() -> None:
    cases = scored_cases({"unet": 0.0}, seeds=(0, 1), folds=1)
    dots = [line for line in spread(cases).axes[0].lines if line.get_marker() == "o"]
    assert sum(len(line.get_ydata()) for line in dots) == 6


def test_outlines_of_the_best_the_median_and_the_worst_case() -> None:
    frames = drawn_frames(5)
    scores = pd.DataFrame({"case_id": frames.case_ids, "dsc": [0.3, 0.9, 0.5, 0.1, 0.7], "hd95_px": 2.0})
    predictions = dict(zip(frames.case_ids, frames.masks, strict=True))
    figure = overlays(frames, predictions, scores)["overlays"]
    assert [axes.get_title().split("\n")[0] for axes in figure.axes] == [
        f"best: {frames.case_ids[1]}",
        f"median: {frames.case_ids[2]}",
        f"worst: {frames.case_ids[3]}",
    ]
    assert "(simulated)" in figure.get_supxlabel()
    assert overlays(frames, predictions, scores.assign(dsc=np.nan)) == {}


def test_curves_of_a_history() -> None:
    history = [{"train_loss": 1.0, "validation_loss": 0.9, "validation_dsc": 0.2}, {"train_loss": 0.5}]
    figure = training_curves(history, 1, "a title")
    losses, dsc = figure.axes
    assert list(losses.lines[0].get_ydata()) == [1.0, 0.5]
    assert np.isnan(dsc.lines[0].get_ydata()[1]) and figure.get_suptitle() == "a title"


@pytest.mark.parametrize("emptied", ["every group", "a data set", "a fold", "all groups but one"])
def test_groups_without_any_vessel_leave_their_places_empty(emptied: str, tmp_path: Path) -> None:
    cases = BOTH.copy()
    rows = {
        "every group": cases["fold"] >= 0,
        "a data set": cases["dataset"] == "x",
        "a fold": cases["fold"] == 0,
        "all groups but one": cases["group"] != "g1",
    }[emptied]
    scores = [name for name in cases if str(name).startswith(("dsc", "hd95", "missed"))]
    cases.loc[rows, scores] = np.nan
    cases.loc[rows, "false_alarm"] = 0.0
    results = [
        JobResult({"fold": int(part["fold"].iloc[0])}, {}, part.reset_index(drop=True), tmp_path)
        for _, part in cases.groupby(["model", "dataset", "fold"])
    ]
    outcome = summarise(results)
    for name, figure in outcome.figures.items():
        save_figure(figure, tmp_path / name, ("png",))
    assert (tmp_path / "spread.png").is_file()
    assert len(outcome.tables["segmentation"]) == 4
    if emptied == "every group":
        assert all("no case with a vessel" in sentence for sentence in outcome.findings[:4])
