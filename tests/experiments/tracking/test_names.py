"""Names that the tracker takes, and that stay different."""

from __future__ import annotations

import pytest
from mlflow.utils.validation import _validate_metric

from experiments.tracking.names import LONGEST, tracked_name


@pytest.mark.parametrize("name", ["dsc_mean", "unet/usgra/dsc_mean", "a - b/x/dsc_p", "unet width 8"])
def test_a_name_that_the_tracker_takes_is_left_alone(name: str) -> None:
    assert tracked_name(name) == name


def test_an_equals_sign_becomes_a_colon() -> None:
    assert tracked_name("unet augmentation=strong/x/dsc") == "unet augmentation:strong/x/dsc"


NAMES = [
    *(
        "a=b",
        "a:b",
        "a=b:c",
        "a:b=c",
        "a=b=c",
        "a,b",
        "a-b",
        "a b",
        "a/b",
        "/a/b",
        "//a/b",
        "a//b",
        "a/",
        "a",
    ),
    *("", ".", "..", "../a", "a/../b", "a/./b", "a/b/", "x" * 250, "x" * 251, "x" * 252, "x" * 249 + "=y"),
    *(
        "x" * 249 + ":y",
        "/" * 300,
        "a" * 238 + "/" * 20,
        "root=/d/p/A",
        "root=/d/p-A",
        "\u00e4",
        "a\n",
        "$x",
        "[x]",
    ),
]


def test_different_names_stay_different_and_are_taken() -> None:
    tracked = [tracked_name(name) for name in NAMES]
    assert len(set(tracked)) == len(NAMES)
    for name in tracked:
        assert len(name) <= LONGEST
        _validate_metric(name, 1.0, 0, 0)
