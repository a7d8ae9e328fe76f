"""Levels of a factor with known differences: tables, pairs on the same cases, and what stands beside them."""

from __future__ import annotations

import pandas as pd
import pytest
from figure_labels import labels
from scored_cases import scored_cases

from experiments.analysis.segmentation.level_figures import level_boxes
from experiments.analysis.segmentation.levels import (
    compare_levels,
    data_label,
    levels,
    levels_metrics,
    levels_table,
    plain_name,
    with_data_choices,
)
from experiments.reporting.published import Published

FACTOR = "configuration"
ABOVE = Published(70, "above", "a set", "section 1", unit="%")
RANGE = Published(60, "range", "a set", "section 1", upper=72, unit="%")
OF_ONE = Published(61.4, "lowest", "a set", "section 1", unit="%", condition={"model": "unet3plus"})


def cases(models: tuple[str, ...] = ("unet",), **more: object) -> pd.DataFrame:
    """Full is 0.1 below single on the same cases, and scored by the networks of two folds."""
    parts = [
        scored_cases(dict.fromkeys(models, gain), groups=8, **more).assign(
            configuration=name, dataset=f"set_{name}", fold=fold
        )
        for name, gain in (("single", 0.1), ("full", 0.0))
        for fold in (0, 1)
    ]
    return pd.concat(parts, ignore_index=True)


def published_of(of: dict[str, str]) -> tuple[Published, ...]:
    return (ABOVE,) if of[FACTOR] == "single" else (OF_ONE,) if of["model"] == "unet3plus" else ()


def test_a_row_for_each_level_and_model_with_each_case_once() -> None:
    table = levels_table(cases(("unet", "unet3plus"), simulated=True), [FACTOR], published_of)
    rows = table.set_index([FACTOR, "model"])
    assert list(rows.index) == [
        (level, model) for level in ("single", "full") for model in ("unet", "unet3plus")
    ]
    assert rows.loc[("single", "unet"), "published"] == "> 70 %"
    assert rows["published"].tolist()[2:] == ["", "down to 61.4 %"]
    assert set(table["data"]) == {"simulated, not comparable"} and set(table["groups"]) == {8}
    alone = cases()
    mean = alone.loc[(alone[FACTOR] == "full") & (alone["fold"] == 0), "dsc"].mean()
    assert rows.loc[("full", "unet"), "dsc"].startswith(f"{mean:.3f} [")


def test_a_level_of_several_parts_of_a_data_set_is_one_row() -> None:
    parts = pd.concat([scored_cases({"unet": 0.0}, dataset=name) for name in ("a", "b")]).assign(level="both")
    table = levels_table(parts, ["level"], lambda of: ())
    assert len(table) == 1
    assert levels_metrics(parts, ["level"])["both/unet/dsc_mean"] == pytest.approx(parts["dsc"].mean())


def test_choices_of_the_data_set_tell_models_apart() -> None:
    chosen = [
        scored_cases({"unet": 0.0}, dataset=name).assign(level="full")
        for name in ("set_full dataset.substitute.strength=0.5", "set_full dataset.substitute.strength=1")
    ]
    named = with_data_choices(pd.concat(chosen, ignore_index=True))
    assert [model for _, model, _ in levels(named, ["level"])] == [
        "unet dataset.substitute.strength=0.5",
        "unet dataset.substitute.strength=1",
    ]
    plain = scored_cases({"unet": 0.0}, dataset="usgra (3 unpaired left out)")
    assert set(with_data_choices(plain)["model"]) == {"unet"}


def test_what_is_known_of_real_data_stands_in_every_row() -> None:
    real = cases()
    assert set(levels_table(real, [FACTOR], published_of, "subject leakage possible")["data"]) == {
        "subject leakage possible"
    }
    assert data_label(real) == "" and data_label(cases(simulated=True)) == " (simulated, not comparable)"


def test_levels_are_compared_on_the_same_cases_by_groups() -> None:
    both = cases(("unet", "attention_unet"))
    # One case that only one level scored.
    compared = compare_levels(both.drop(index=[0, 1]), FACTOR, "the test")
    dsc = compared[compared["metric"] == "dsc"].set_index("dataset")
    assert list(dsc.index) == ["the test, unet", "the test, attention_unet"]
    assert dsc["mean_difference"].to_numpy() == pytest.approx(0.1)
    assert dsc["units"].tolist() == [8, 8]
    # Eight groups all on one side: 2 / 2**8.
    assert dsc["p"].to_numpy() == pytest.approx(2 / 256)
    assert set(dsc["verdict"]) == {"single better"}


def test_smoke_trained_networks_are_compared_with_nothing() -> None:
    smoke = cases(("smoke-trained unet",))
    assert not len(compare_levels(smoke, FACTOR, "the test"))
    assert plain_name("smoke-trained unet model.width=8") == "unet"
    assert [model for _, model, _ in levels(smoke, [FACTOR])] == ["smoke-trained unet"] * 2


def test_the_figure_has_a_box_for_each_level_and_model_and_the_published_values() -> None:
    shown = cases(("unet", "unet3plus"), simulated=True)
    order = {"single": "Single", "full": "Full", "none": "Not there"}
    figure = level_boxes({"On the test": shown}, FACTOR, order, published_of, "A title")
    dsc, hd95 = figure.axes
    assert [tick.get_text() for tick in dsc.get_xticklabels()] == ["Single", "Full"]
    boxes = [patch for patch in dsc.patches if hasattr(patch, "get_path")]
    assert len(boxes) == 4 and hd95.get_ylabel() == "HD95 (px)"
    lines = [line for line in dsc.lines if line.get_label() == "Published"]
    # One bound over the whole level, one value at the network that it is of.
    assert [line.get_ydata()[0] for line in lines] == pytest.approx([0.70, 0.614])
    assert [float(max(line.get_xdata())) - float(min(line.get_xdata())) for line in lines] == pytest.approx(
        [0.8, 0.4]
    )
    assert {"U-Net", "UNet 3+", "Published"} <= set(labels(figure))


def test_a_published_range_is_a_hatched_box() -> None:
    figure = level_boxes(
        {"On the test": cases()}, FACTOR, {"single": "Single"}, lambda of: (RANGE,), "A title"
    )
    (box,) = [patch for patch in figure.axes[0].patches if patch.get_hatch()]
    assert (box.get_y(), box.get_height()) == pytest.approx((0.60, 0.12))
