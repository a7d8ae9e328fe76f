"""The figures draw the rates that are in the rows, and every panel there should be."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
from robustness_rows import FAR, GOOD, binned, many, row

from experiments.studies.robustness.rate_figures import figures


def lines(axes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {each.get_label(): each.lines[0].get_data() for each in axes.containers}


def visible(figure) -> list:
    return [axes for axes in figure.axes if axes.get_visible()]


def test_a_whole_study_has_all_figures_and_they_can_be_written(tmp_path: Path) -> None:
    cases = many(["multistart", "single_icp", "gicp"], trials=2)
    drawn = figures(cases)
    assert set(drawn) == {
        "success_by_angle",
        "success_by_roll",
        "errors",
        "success_curve",
        "factors",
        "rmse_tre",
        "runtime",
        "risk_coverage",
    }
    assert len(visible(drawn["success_by_angle"])) == 10
    assert len(drawn["factors"].axes) == 4
    for name, figure in drawn.items():
        figure.savefig(tmp_path / f"{name}.png", dpi=40)


def test_success_by_angle_has_the_rate_of_each_bin_and_of_flips_apart() -> None:
    flips = [
        row("good", rotation="flip", trial=n, angle_deg=180.0, angle_from_deg=math.nan, angle_to_deg=math.nan,
            tre_mm=GOOD if n else FAR)
        for n in range(2)
    ]  # fmt: skip
    drawn = figures(pd.DataFrame([*binned("good", [4, 3]), *flips, *binned("bad", [1, 0])]))
    (axes,) = visible(drawn["success_by_angle"])
    found = [each.lines[0].get_data() for each in axes.containers]
    assert [each[1].tolist() for each in found] == [[1.0, 0.75], [0.5], [0.25, 0.0]]
    np.testing.assert_allclose(found[0][0], [7.5, 22.5], atol=6)
    assert found[1][0][0] > 180
    assert axes.get_xticklabels()[-1].get_text() == "flip"
    assert axes.get_title() == "Overlap 1 (n = 2 to 4 a point)"
    assert [text.get_text() for text in drawn["success_by_angle"].legends[0].get_texts()] == ["good", "bad"]


def test_trials_without_an_angle_have_a_panel_that_names_no_number() -> None:
    drawn = figures(pd.DataFrame([row("good", angle_from_deg=math.nan, angle_to_deg=math.nan)]))
    (axes,) = visible(drawn["success_by_angle"])
    assert axes.get_title() == "Overlap 1"


def test_rolls_have_a_figure_of_their_own() -> None:
    rolls = binned("good", [4, 1], rotation="roll")
    drawn = figures(pd.DataFrame([*binned("good", [4, 4]), *rolls]))
    assert lines(drawn["success_by_roll"].axes[0])["good"][1].tolist() == [1.0, 0.25]
    assert lines(drawn["success_by_angle"].axes[0])["good"][1].tolist() == [1.0, 1.0]


def test_the_curve_is_the_share_within_each_distance() -> None:
    cases = pd.DataFrame([row(tre_mm=tre, trial=n) for n, tre in enumerate((0.5, 3.0, 3.0, math.inf))])
    at_mm, shares = figures(cases)["success_curve"].axes[0].lines[0].get_data()
    assert at_mm[:4].tolist() == [0.0, 0.5, 3.0, 3.0]
    assert shares[:4].tolist() == [0.0, 0.25, 0.5, 0.75]
    assert at_mm[-2] >= 10, "a failure is never within reach"


def test_factors_show_success_and_the_median_error_by_level() -> None:
    rows = [row(factor="noise_mm", level=level, trial=n, tre_mm=tre)
            for level, errors in ((0.0, (0.1, 0.2, 0.3)), (1.0, (0.4, 5.0, 9.0)))
            for n, tre in enumerate(errors)]  # fmt: skip
    above, below = figures(pd.DataFrame(rows))["factors"].axes
    at, rates = lines(above)["Multi-start ICP"]
    assert (at.tolist(), rates.tolist()) == ([0.0, 1.0], [1.0, 1 / 3])
    assert below.lines[0].get_ydata().tolist() == [0.2, 5.0]
    assert below.get_xlabel() == "Noise, standard deviation (mm)"


def test_the_risk_curve_takes_accepted_results_first() -> None:
    cases = pd.DataFrame(
        [
            row(accepted=False, tre_mm=FAR, tre_high_mm=0.1),
            row(tre_high_mm=0.5),
            row(tre_mm=FAR, tre_high_mm=0.9),
            row(tre_high_mm=0.7),
        ]
    )
    curve, dot = figures(cases)["risk_coverage"].axes[0].lines
    np.testing.assert_allclose(curve.get_ydata(), [1, 1, 2 / 3, 1 / 2])
    np.testing.assert_allclose(curve.get_xdata(), [0.25, 0.5, 0.75, 1])
    assert [float(value) for value in (dot.get_xdata()[0], dot.get_ydata()[0])] == [0.75, 2 / 3]
    silent = pd.DataFrame([row(tre_low_mm=math.nan, tre_high_mm=math.nan)])
    assert "risk_coverage" not in figures(silent)


def test_conditions_have_panels_of_their_own_under_one_method_name(tmp_path: Path) -> None:
    rows = [
        *binned("multistart", [4, 4], overlap=1.0),
        *binned("single_icp", [4, 0], overlap=1.0),
        *(row(name, factor="noise_mm", level=float(level))
          for name in ("multistart", "single_icp") for level in (0, 1)),
    ]  # fmt: skip
    near, far = pd.DataFrame(rows), pd.DataFrame(rows).assign(tre_mm=FAR, success_tre=False)
    drawn = figures(
        pd.concat(
            [near.assign(condition="noise_mm=0"), far.assign(condition="noise_mm=1")], ignore_index=True
        )
    )
    for name, panels in {
        "success_by_angle": 2,
        "errors": 4,
        "success_curve": 2,
        "factors": 4,
        "rmse_tre": 4,
        "runtime": 1,
        "risk_coverage": 2,
    }.items():
        assert len(visible(drawn[name])) == panels, name
        drawn[name].savefig(tmp_path / f"{name}.png", dpi=40)
    above, below = visible(drawn["success_by_angle"])
    assert [above.get_title(), below.get_title()] == [
        f"Overlap 1, noise_mm={level} (n = 4 a point)" for level in (0, 1)
    ]
    assert lines(above)["ICP"][1].tolist() == [1.0, 0.0]
    assert lines(below)["ICP"][1].tolist() == [0.0, 0.0]
    legend = drawn["success_by_angle"].legends[0].get_texts()
    assert [text.get_text() for text in legend] == ["Multi-start ICP", "ICP"]
    labels = [label.get_text() for label in drawn["runtime"].axes[0].get_yticklabels()]
    assert labels == [f"{name}, noise_mm={level}" for level in (0, 1) for name in ("Multi-start ICP", "ICP")]
