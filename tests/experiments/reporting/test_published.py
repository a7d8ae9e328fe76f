"""Published values are read from one file, and never stand bare beside simulated ones."""

from __future__ import annotations

import pytest
import yaml

from experiments.errors import InputError
from experiments.paths import conf_dir
from experiments.reporting.published import Published, published


def test_every_value_is_whole() -> None:
    known = yaml.safe_load((conf_dir() / "published.yaml").read_text(encoding="utf-8"))
    for study, values in known.items():
        for metric in values:
            assert published(study, metric).place


def test_a_value_beside_simulated_and_real_ones() -> None:
    value = published("consistency", "hd95_mm_median")
    assert (value.value, value.text) == (0.8, "< 0.8")
    assert value.text_for(simulated=False) == "< 0.8"
    assert value.text_for(simulated=True) == "< 0.8 (not comparable: simulated)"


def test_unknown_values_and_relations_are_refused() -> None:
    for study, metric in (("consistency", "dsc"), ("cooking", "hd95_mm")):
        with pytest.raises(InputError, match=f"published: expected a value of {study}.{metric}, found none"):
            published(study, metric)
    with pytest.raises(InputError, match="relation: expected below, about, received 'over'"):
        Published(0.8, "over", "phantoms", "section 4.1")
