"""The published data sets in small: their folders and file names as they are, pixels drawn."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
from PIL import Image

CAROTID = "Common Carotid Artery Ultrasound Images"
# What can be wrong with one image and its mask: a name, what to do to the two files, and what must be said of it.
Damage = tuple[str, Callable[[Path, Path], object], str]
DAMAGES: tuple[Damage, ...] = (
    ("text for an image", lambda image, mask: image.write_text("no image"), "that can't be read as one"),
    ("text for a mask", lambda image, mask: mask.write_bytes(b""), "that can't be read as one"),
    (
        "cut image",
        lambda image, mask: image.write_bytes(image.read_bytes()[:60]),
        "that was cut short",
    ),
    ("small mask", lambda image, mask: grey(mask, np.zeros((5, 4))), "image's size .*, received 4x5"),
    ("label 7", lambda image, mask: grey(mask, np.full(size_of(image), 7)), "expected labels .*, received 7"),
)
# What has no partner is not named alone but listed with all else that has none.
LONELY: tuple[Damage, ...] = (
    ("no mask", lambda image, mask: mask.unlink(), "found no mask for 1 image"),
    ("no image", lambda image, mask: image.unlink(), "found no image for 1 mask"),
)
LONELY_NAMES = [name for name, _, _ in LONELY]
DAMAGE_NAMES = [name for name, _, _ in DAMAGES]


def grey(path: Path, pixels: np.ndarray) -> None:
    """Write a grey PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels.astype(np.uint8)).save(path)


def colour(path: Path, pixels: np.ndarray) -> None:
    """Write a grey picture as RGB."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.dstack([pixels.astype(np.uint8)] * 3)).save(path)


def size_of(path: Path) -> tuple[int, int]:
    """Height and width of an image."""
    with Image.open(path) as image:
        return image.size[1], image.size[0]


def speckle(seed: int, size: tuple[int, int] = (10, 12)) -> np.ndarray:
    """A picture that no other seed gives."""
    return np.random.default_rng(seed).integers(20, 120, size).astype(np.uint8)


def write_carotid(around: Path, counts: Mapping[str, int], value: int = 255) -> Path:
    """``counts`` images of each recording; image ``i`` of all has speckle ``i`` and a vessel of 4 pixels."""
    number = 0
    for recording, count in counts.items():
        for index in range(count):
            name = f"{recording}_slice_{index + 5}.png"
            mask = np.zeros((10, 12))
            mask[2:4, 5:7] = value
            colour(around / CAROTID / "US images" / name, speckle(number))
            colour(around / CAROTID / "Expert mask images" / name, mask)
            number += 1
    return around


def write_musv(
    root: Path, sequences: Mapping[str, tuple[str, int, tuple[int, int]]], vein: int = 1, artery: int = 2
) -> Path:
    """Sequences by name: part, number of frames, size. A vein of 6 pixels, and an artery of 4 but for frame 0."""
    for part in ("train", "valid"):
        (root / "Videos" / part).mkdir(parents=True, exist_ok=True)
    for sequence, (part, count, size) in sequences.items():
        for frame in range(count):
            name = f"{sequence}_{frame:03d}.png"
            labels = np.zeros(size)
            labels[1:3, 1:4] = vein
            if frame:
                labels[5:7, 6:8] = artery
            colour(root / "Videos" / part / sequence / name, speckle(frame, size))
            grey(root / "Annotations" / sequence / name, labels)
        (root / "Forces").mkdir(exist_ok=True)
        (root / "Forces" / f"{sequence}.txt").write_text("0.5\n" * count)
    return root


def write_san_raffaele(
    root: Path,
    sessions: Iterable[tuple[str, str, str, int]],
    value: int = 255,
    size: tuple[int, int] = (24, 26),
) -> Path:
    """Sessions as (name, subject, excluded, number of frames), frames numbered without leading zeros."""
    rows = []
    for number, (session, subject, excluded, count) in enumerate(sessions):
        for frame in range(count):
            mask = np.zeros(size)
            mask[4:7, 5:9] = value
            colour(root / session / "images" / f"frame_{frame}.png", speckle(1000 * number + frame, size))
            grey(root / session / "masks" / f"frame_{frame}.png", mask)
        rows.append([session, subject, f"2024-01-{number + 1:02d}", f"scanner {number % 2}", excluded])
    with (root / "sessions.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["session", "subject", "date", "scanner", "excluded"], *rows])
    return root
