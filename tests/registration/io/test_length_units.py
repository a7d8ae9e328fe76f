"""Units of length as headers spell them."""

from __future__ import annotations

from pathlib import Path

import pytest

from registration.errors import InputError
from registration.io.length_units import quoted, require_plain_lengths, stated_units

FILE = Path("a.nrrd")


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ('"cm" "cm" "cm"', ("cm", "cm", "cm")),
        ('"mm" "MM" "millimeters"', ("mm", "mm", "mm")),
        ("mm mm cm", ("mm", "mm", "cm")),
        ('"um" "microns" "Âµm"', ("um", "um", "um")),
        ('"meters" "m" "metre"', ("m", "m", "m")),
        ('"" "" ""', ()),
        ("??? ??? ???", ()),
        ("", ()),
    ],
)
def test_spellings(text: str, units: tuple[str, ...]) -> None:
    assert stated_units(quoted(text), "space units", FILE) == units


@pytest.mark.parametrize("text", ['"inch" "inch" "inch"', '"mm" "mm" ""', '"mm" "mm" "s"'])
def test_other_units_and_units_of_some_axes_alone_are_refused(text: str) -> None:
    with pytest.raises(
        InputError, match=r"a\.nrrd: expected space units of mm, cm, m, um for every axis, found"
    ):
        stated_units(quoted(text), "space units", FILE)


@pytest.mark.parametrize("text", ["1 0 0 1e308", "(1,0,0) (0,inf,0)", "-2e9", "1 Infinity 3"])
def test_lengths_that_no_volume_has_are_refused(text: str) -> None:
    with pytest.raises(
        InputError, match=r"a\.mha: expected lengths and directions of a volume in Offset, found"
    ):
        require_plain_lengths(text, "Offset", Path("a.mha"))


@pytest.mark.parametrize("text", ["", "1 0 0 -0.5e-3", "(1,0,0) none", "nan 0.5", "999999999"])
def test_other_fields_are_left_to_others(text: str) -> None:
    require_plain_lengths(text, "Offset", Path("a.mha"))
