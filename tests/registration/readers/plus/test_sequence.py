"""Orientations of PLUS, by frames whose corners are marked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.readers.plus.sequence import PlusSequence, to_mf

# Marked side is the last column, far is the last row: 1 near unmarked, 2 near marked, 3 far unmarked, 4 far marked.
MF = np.array([[[1, 0, 2], [3, 0, 4]]], dtype=np.uint8)


@pytest.mark.parametrize(
    ("orientation", "stored"),
    [
        ("MF", MF),
        ("MFA", MF),
        ("MFD", MF),
        ("UF", MF[:, :, ::-1]),
        ("MN", MF[:, ::-1]),
        ("UNA", MF[:, ::-1, ::-1]),
        ("FM", np.swapaxes(MF, 1, 2)),
        ("NU", np.swapaxes(MF[:, ::-1, ::-1], 1, 2)),
    ],
)
def test_stored_frames_are_turned_to_mf(orientation: str, stored: np.ndarray) -> None:
    np.testing.assert_array_equal(to_mf(stored, orientation, Path("a.mha")), MF)


@pytest.mark.parametrize("orientation", ["", "M", "MM", "FN", "XX", "MFX", "MFAA"])
def test_unknown_orientation_is_refused(orientation: str) -> None:
    with pytest.raises(InputError, match=r"a\.mha: expected an image orientation"):
        to_mf(MF, orientation, Path("a.mha"))


def test_colour_frames_keep_their_channels() -> None:
    colour = np.arange(24, dtype=np.uint8).reshape(1, 2, 4, 3)
    np.testing.assert_array_equal(to_mf(colour, "UF", Path("a.mha"))[0, 1, 0], colour[0, 1, 3])


def test_frames_and_fields_must_be_as_many() -> None:
    with pytest.raises(InputError, match=r"pixels: expected shape \(2, height, width\)"):
        PlusSequence(MF, ({}, {}))
