"""Scanner screens drawn by hand: speckle within a known sector, text and marks around it."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont


def speckle(size: tuple[int, int], mean: float = 90.0, seed: int = 0) -> np.ndarray:
    """Grey values as of a log-compressed Rayleigh envelope, never below 1, grains of about 2 x 3 pixels."""
    from scipy.ndimage import uniform_filter

    rng = np.random.default_rng(seed)
    field = [uniform_filter(rng.normal(size=size), (2, 3)) for _ in range(2)]
    envelope = np.hypot(*field)
    grey = mean + 40 * np.log10(envelope / envelope.mean() + 1e-3)
    return np.clip(np.rint(grey), 1, 200).astype(np.uint8)


def rectangle(size: tuple[int, int], top: int, left: int, bottom: int, right: int) -> np.ndarray:
    """The region of a linear probe."""
    inside = np.zeros(size, bool)
    inside[top:bottom, left:right] = True
    return inside


def fan(
    size: tuple[int, int], apex: tuple[float, float], radii_px: tuple[float, float], half_deg: float
) -> np.ndarray:
    """The region of a curved probe: between two radii around the apex (row, column), straight down and to each side."""
    row, column = np.mgrid[: size[0], : size[1]]
    down, across = row - apex[0], column - apex[1]
    distance = np.hypot(down, across)
    near = (distance >= radii_px[0]) & (distance <= radii_px[1])
    return near & (np.abs(np.degrees(np.arctan2(across, down))) <= half_deg)


def disc(size: tuple[int, int], centre: tuple[float, float], radius: float) -> np.ndarray:
    """An anechoic area."""
    row, column = np.mgrid[: size[0], : size[1]]
    return (row - centre[0]) ** 2 + (column - centre[1]) ** 2 <= radius**2


def written(
    image: np.ndarray, text: str, place: tuple[int, int], size: int = 16, ink: object = 255
) -> np.ndarray:
    """The image with text whose upper left corner is at place (row, column)."""
    picture = Image.fromarray(image)
    font = ImageFont.load_default(size)
    ImageDraw.Draw(picture).text(place[::-1], text, fill=ink, font=font)  # type: ignore[arg-type]
    return np.array(picture)


def cross_hairs(image: np.ndarray, centre: tuple[int, int], arm: int, ink: object = 255) -> np.ndarray:
    """The image with two crossed lines one pixel wide."""
    marked = image.copy()
    row, column = centre
    marked[row, column - arm : column + arm + 1] = ink
    marked[row - arm : row + arm + 1, column] = ink
    return marked
