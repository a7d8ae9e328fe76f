"""Contact sheets: pictures at their places, shapes kept."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.reporting.contact_sheet import GAP_PX, contact_sheet, outlined
from registration.errors import InputError


def test_pictures_stand_in_rows_and_keep_their_shape() -> None:
    wide, tall = np.full((10, 20), 100, dtype=np.uint8), np.full((20, 10), 200, dtype=np.uint8)
    sheet = contact_sheet([[wide, tall], [tall]], 40)
    step = 40 + GAP_PX
    assert sheet.shape == (2 * step, 2 * step)
    assert (sheet[:20, :40] == 100).all()
    assert not sheet[20:40, :40].any()
    assert (sheet[:40, step : step + 20] == 200).all()
    assert (sheet[step : step + 40, :20] == 200).all()
    assert not sheet[step:, step:].any()


def test_an_empty_sheet_is_refused() -> None:
    for rows in ([], [[]]):
        with pytest.raises(InputError, match="rows"):
            contact_sheet(rows, 40)


def test_outline_is_white_and_touches_nothing_else() -> None:
    picture = np.full((9, 9), 50, dtype=np.uint8)
    mask = np.zeros((9, 9), dtype=bool)
    mask[3:6, 3:6] = True
    drawn = outlined(picture, mask)
    assert drawn[3, 4] == 255
    assert drawn[4, 4] == 50
    assert (drawn[:2] == 50).all()
    assert (drawn[8] == 50).all()
