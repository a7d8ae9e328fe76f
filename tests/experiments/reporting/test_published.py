"""Published values are read from one file, and never stand bare beside simulated ones."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from experiments.errors import InputError
from experiments.reporting.published import RELATIONS, Published, matching, published, published_values

NAN = float("nan")
EVERY = [(study, name) for study, values in published_values().items() for name in values]


def made(value: float, relation: str, **more: object) -> Published:
    return Published(value, relation, "phantoms", "section 4.1", **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(("study", "name"), EVERY)
def test_every_value_is_whole(study: str, name: str) -> None:
    value = published(study, name)
    assert value.place.startswith("section ") and value.data and value.metric and value.dataset
    # A sentence has the unit of what is measured beside it, if that has one.
    assert value.unit or value.relation == "stated"


def test_every_study_of_the_summary_has_its_values() -> None:
    assert set(published_values()) == {
        *("consistency", "robustness", "accuracy", "runtime"),
        *("segmentation", "dataset_variability", "vessel_type"),
    }


@pytest.mark.parametrize(("study", "name"), EVERY)
def test_numbers_stand_in_the_section_that_is_named(real_data: Path, study: str, name: str) -> None:
    summary = real_data.parent / "thesis-summary.txt"
    if not summary.is_file():
        pytest.skip("thesis-summary.txt is not there")
    value = published(study, name)
    section = re.search(r'"(.+?)"', value.place)
    assert section is not None
    # A heading of the results ends with a full stop and opens its paragraph.
    text = re.sub(r"\s+", " ", summary.read_text(encoding="utf-8").split("4. Results and Discussion")[1])
    paragraph = text.split(f"{section[1]}. ", 1)[1][:1100]
    for number in (value.value, value.upper):
        if number is not None and not math.isnan(number):
            assert re.search(rf"(?<![\d.]){number:g}(?![\d.]*\d)", paragraph), number


def test_a_value_beside_simulated_and_real_ones() -> None:
    value = published("consistency", "hd95_mm_median")
    assert (value.value, value.text, value.text_with_unit) == (0.8, "< 0.8", "< 0.8 mm")
    assert value.text_for(simulated=False) == "< 0.8"
    assert value.text_for(simulated=True) == "< 0.8 (not comparable: simulated)"


@pytest.mark.parametrize(
    ("value", "text", "bounds", "inside", "outside", "difference"),
    [
        (made(0.8, "below", unit="mm"), "< 0.8 mm", (-math.inf, 0.8), 0.79, 0.8, 0.0),
        (made(82, "above", unit="%"), "> 82 %", (0.82, math.inf), 0.83, 0.82, 0.0),
        (made(89, "range", upper=93, unit="%"), "89 to 93 %", (0.89, 0.93), 0.93, 0.94, 0.01),
        (made(40, "range", upper=70, unit="s"), "40 to 70 s", (40, 70), 40, 4, -36),
    ],
)
def test_bounds_are_in_the_unit_of_the_metric(
    value: Published,
    text: str,
    bounds: tuple[float, float],
    inside: float,
    outside: float,
    difference: float,
) -> None:
    assert value.text_with_unit == text
    assert value.bounds == pytest.approx(bounds)
    assert value.met(inside) is True and value.met(outside) is False
    assert value.difference(inside) == 0.0
    assert value.difference(outside) == pytest.approx(difference)


def test_what_is_no_bound_is_neither_met_nor_missed() -> None:
    about, lowest = made(1.4, "about", unit="mm"), made(61.4, "lowest", unit="%")
    assert (about.text_with_unit, lowest.text_with_unit) == ("about 1.4 mm", "down to 61.4 %")
    assert about.met(1.4) is None and lowest.met(0.5) is None
    assert about.difference(1.5) == pytest.approx(0.1)
    assert lowest.difference(0.6) == pytest.approx(-0.014)
    sentence = made(NAN, "stated", statement="partially recovered")
    assert sentence.text_with_unit == "partially recovered" and sentence.met(0.7) is None
    assert math.isnan(sentence.difference(0.7))


def test_a_measured_value_gets_the_values_of_its_own_condition() -> None:
    def texts(study: str, metric: str, **of: str) -> list[str]:
        return [value.text_with_unit for value in matching(study, metric, **of)]

    of = {"configuration": "full", "dataset": "san_raffaele"}
    assert texts("dataset_variability", "dsc", model="unet3plus", **of) == ["down to 61.4 %"]
    assert texts("dataset_variability", "dsc", model="unet", **of) == []
    assert texts("dataset_variability", "dsc", model="unet", configuration="single_session") == ["> 82 %"]
    assert texts("dataset_variability", "dsc", configuration="pruned") == []
    stated = matching("dataset_variability", "dsc", configuration="pruned", stated=True)
    assert [value.text for value in stated] == ["performance partially recovered"]
    assert texts("segmentation", "dsc", model="unet", dataset="carotid") == ["89 to 93 %"]
    assert texts("segmentation", "dsc", model="unet", dataset="usgra") == []
    assert texts("accuracy", "rmse_mm", phantom="artery", stage="deformable") == ["< 0.6 mm"]
    assert texts("cooking", "dsc") == []


def test_unknown_values_and_relations_are_refused() -> None:
    for study, metric in (("consistency", "dsc"), ("cooking", "hd95_mm")):
        with pytest.raises(InputError, match=f"published: expected a value of {study}.{metric}, found none"):
            published(study, metric)
    with pytest.raises(InputError, match=f"relation: expected {', '.join(RELATIONS)}, received 'over'"):
        made(0.8, "over")


@pytest.mark.parametrize(
    ("value", "relation", "more", "message"),
    [
        (40.0, "range", {}, "upper: expected an end of a range"),
        (40.0, "below", {"upper": 70.0}, "upper: expected an end of a range"),
        (70.0, "range", {"upper": 40.0}, "upper: expected more than 70, received 40"),
        (NAN, "stated", {}, "statement: expected a sentence or a value"),
        (1.0, "stated", {"statement": "low"}, "statement: expected a sentence or a value"),
    ],
)
def test_numbers_go_with_the_relation(
    value: float, relation: str, more: dict[str, object], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        made(value, relation, **more)
