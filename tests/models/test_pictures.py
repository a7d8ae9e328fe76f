"""Pictures of frames for notebooks: PNG that other programs read, with the outline where the mask ends."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
from PIL import Image

from models.pictures import OUTLINE, SHOWN, SIDE_PX, frames_picture, png


def pictures(html: str) -> list[np.ndarray]:
    found = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
    return [np.asarray(Image.open(io.BytesIO(base64.b64decode(each)))) for each in found]


def test_a_png_is_read_by_pillow_with_every_pixel() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (7, 11, 3)).astype(np.uint8)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(png(pixels)))), pixels)


def test_the_outline_is_the_border_of_the_mask_and_all_else_is_the_frame() -> None:
    image = np.full((20, 30), 40, dtype=np.uint8)
    mask = np.zeros((20, 30), dtype=bool)
    mask[5:10, 8:16] = True
    (shown,) = pictures(frames_picture([image], [mask]))
    border = mask.copy()
    border[6:9, 9:15] = False
    np.testing.assert_array_equal((shown == OUTLINE).all(axis=-1), border)
    assert (shown[~border] == 40).all()


def test_some_frames_are_chosen_named_and_made_small() -> None:
    images = np.zeros((40, 300, 400), dtype=np.uint8)
    html = frames_picture(images, images > 0, [f"case <{number}>" for number in range(40)])
    shown = pictures(html)
    assert len(shown) == SHOWN
    assert max(max(each.shape[:2]) for each in shown) <= SIDE_PX
    assert "case &lt;0&gt;" in html and "case &lt;39&gt;" in html


def test_probabilities_and_colours_are_drawn_too() -> None:
    mask = np.zeros((4, 5), dtype=bool)
    (grey,) = pictures(frames_picture([np.full((4, 5), 0.5, dtype=np.float32)], [mask]))
    assert (grey == 127).all()
    (color,) = pictures(frames_picture([np.full((4, 5, 3), (1, 2, 3), dtype=np.uint8)], [mask]))
    assert (color == (1, 2, 3)).all()
