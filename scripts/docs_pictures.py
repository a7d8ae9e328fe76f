"""Put the pictures of pages that the documentation shows in their place, from those that the tests of pages saved.

``make docs-pictures`` runs ``make test-pages`` and then ``python scripts/docs_pictures.py FOLDER``. Pictures lose
the empty rows at their end, and get a palette of 256 colours where they would be large files.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from experiments.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
# What the names of pictures of pages begin with; others come from commands of their own.
PAGES = ("dashboard_", "report_", "scene_", "sweep_")
MAX_BYTES = 250_000
_PICTURE = re.compile(r"!\[[^\]]*\]\((?P<target>[^)\s]+\.png)\)")


def main() -> int:
    """Write every picture that the documentation shows of a page; 2 where one is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where make test-pages saved its pictures (PAGES)")
    folder = parser.parse_args().folder
    try:
        for path in pictures_of_pages(ROOT / "docs"):
            print(f"{path.relative_to(ROOT)}: {small_picture(folder / path.name, path) / 1000:.0f} kB")
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    return 0


def pictures_of_pages(docs: Path) -> list[Path]:
    """The pictures of pages that a folder of documentation shows.

    Parameters
    ----------
    docs : pathlib.Path
        Folder of Markdown files.

    Returns
    -------
    list of pathlib.Path
        Their files, each once.
    """
    found = set()
    for page in docs.rglob("*.md"):
        for match in _PICTURE.finditer(page.read_text(encoding="utf-8")):
            path = (page.parent / match["target"]).resolve()
            if path.name.startswith(PAGES):
                found.add(path)
    return sorted(found)


def small_picture(source: Path, place: Path) -> int:
    """Write a picture without the empty rows at its end, with a palette if its file would be large.

    Parameters
    ----------
    source : pathlib.Path
        Picture as the browser saved it.
    place : pathlib.Path
        Where it goes.

    Returns
    -------
    int
        Size of the file in bytes.

    Raises
    ------
    InputError
        If there is no such picture, or it stays too large.
    """
    if not source.is_file():
        raise InputError(f"{source}: expected a picture that make test-pages saves, found none")
    with Image.open(source) as opened:
        picture = opened.convert("RGB")
    drawn = np.ptp(np.asarray(picture), axis=1).any(axis=1).nonzero()[0]
    last = min(picture.height, int(drawn[-1]) + 12) if len(drawn) else picture.height
    picture = picture.crop((0, 0, picture.width, last))
    picture.save(place, optimize=True)
    if place.stat().st_size > MAX_BYTES:
        # By the colours that there are, not by how often: scales are narrow, and frames are large and grey.
        picture.quantize(256, Image.Quantize.MAXCOVERAGE).save(place, optimize=True)
    size = place.stat().st_size
    if size > MAX_BYTES:
        raise InputError(f"{place}: expected at most {MAX_BYTES} bytes, received {size}")
    return size


if __name__ == "__main__":
    sys.exit(main())
