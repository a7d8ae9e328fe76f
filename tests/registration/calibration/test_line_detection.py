"""A drawn line is found where it was drawn, and not where none is."""

from __future__ import annotations

import numpy as np
import pytest

from registration.calibration.line_detection import LineDetector
from registration.errors import InputError


def drawn(slope: float, row_at_middle: float, height: int = 90, width: int = 121) -> np.ndarray:
    """A bright line of Gaussian profile over weak noise."""
    rows, columns = np.mgrid[:height, :width]
    line = 200 * np.exp(-0.5 * ((rows - row_at_middle - slope * (columns - (width - 1) / 2)) / 1.5) ** 2)
    return np.clip(line + np.random.default_rng(0).uniform(0, 20, line.shape), 0, 255).astype(np.uint8)


def test_row_at_the_middle_column() -> None:
    images = np.stack([drawn(0.0, 40.3), drawn(0.25, 52.7), drawn(-0.1, 11.0)])
    np.testing.assert_allclose(LineDetector()(images), [40.3, 52.7, 11.0], atol=0.15)


def test_bright_spots_beside_the_line_do_not_move_it() -> None:
    image = drawn(0.1, 60.0)
    image[5:15, 20:50] = 255
    assert LineDetector()(image[None])[0] == pytest.approx(60.0, abs=0.2)


def test_clip_rectangle_leaves_a_brighter_line_out() -> None:
    image = drawn(0.0, 60.0)
    image[3:6] = 255
    detector = LineDetector(clip_origin_px=(10, 20), clip_size_px=(100, 60))
    assert detector(image[None])[0] == pytest.approx(60.0, abs=0.2)


def test_no_line_is_said_so() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (1, 90, 121)).astype(np.uint8)
    assert np.isnan(LineDetector()(noise)).all()
    assert np.isnan(LineDetector()(np.zeros((1, 90, 121), np.uint8))).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"scanlines": 2}, "scanlines"),
        ({"inlier_px": 0.0}, "inlier_px"),
        ({"clip_origin_px": (1, 1)}, "both or neither"),
    ],
)
def test_settings_are_checked(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        LineDetector(**settings)  # type: ignore[arg-type]


def test_clip_rectangle_outside_the_image_is_refused() -> None:
    with pytest.raises(InputError, match="clip rectangle: expected within 121x90 px"):
        LineDetector(clip_origin_px=(100, 0), clip_size_px=(50, 50))(drawn(0.0, 40.0)[None])
