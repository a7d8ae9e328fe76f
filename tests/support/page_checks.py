"""What tests ask of a page in the browser: sizes of its text, what the keyboard reaches, where its colours are."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

if TYPE_CHECKING:
    from chromium import Page

# Elements with text of their own that are seen; plotly measures texts in an element far to the left.
_TEXTS = """[...document.querySelectorAll('body *')].filter(e => {
  const place = e.getBoundingClientRect();
  return !e.closest('script, style, noscript') && place.width && place.height && place.right > 0
    && getComputedStyle(e).visibility === 'visible'
    && [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim());
})"""
# Colours at least so far from grey, out of 255.
_COLORED = 50


def smallest_text_px(page: Page) -> float:
    """The size of the smallest text that is seen, in px."""
    return float(page.value(f"Math.min(...{_TEXTS}.map(e => parseFloat(getComputedStyle(e).fontSize)))"))


def cut_texts(page: Page, frames: str = "") -> list[str]:
    """Texts that reach over an edge of the window, apart from those in frames that scroll by themselves."""
    apart = f".filter(e => !e.closest({frames!r}))" if frames else ""
    return list(
        page.value(
            f"{_TEXTS}{apart}.filter(e => e.getBoundingClientRect().right > innerWidth + 1 || "
            "e.getBoundingClientRect().left < -1).map(e => e.textContent)"
        )
    )


def reached_by_tab(page: Page, presses: int) -> list[str]:
    """The id, or the text, of what has the focus after each press of the key."""
    found = []
    for _ in range(presses):
        page.press("Tab", 9)
        found.append(page.value("document.activeElement.innerText || document.activeElement.id"))
        if page.value("['application'].includes(document.activeElement.role)"):
            found[-1] = page.value("document.activeElement.id")
    return [str(name).strip() for name in found]


def colored_box(page: Page, element: str) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of the coloured pixels of an element, as shares of its sides."""
    x, y, width, height = page.value(
        f"(r => [r.x, r.y, r.width, r.height])(document.querySelector({element!r}).getBoundingClientRect())"
    )
    pixels: Any = np.asarray(Image.open(io.BytesIO(page.picture())).convert("RGB")).astype(int)
    pixels = pixels[int(y) : int(y + height), int(x) : int(x + width)]
    rows, columns = np.nonzero(np.ptp(pixels, axis=2) > _COLORED)
    assert len(rows), f"{element}: expected coloured pixels, found none"
    box = (columns.min() / width, rows.min() / height, columns.max() / width, rows.max() / height)
    return (float(box[0]), float(box[1]), float(box[2]), float(box[3]))


def save_picture(page: Page, name: str, height: int | None = None) -> None:
    """Save the upper ``height`` px of the window, or all of it, in the folder of ``CTUS_SCREENSHOTS``, if it is set."""
    if folder := os.environ.get("CTUS_SCREENSHOTS"):
        picture = Image.open(io.BytesIO(page.picture())).convert("RGB")
        Path(folder).mkdir(parents=True, exist_ok=True)
        picture.crop((0, 0, picture.width, height or picture.height)).save(Path(folder) / f"{name}.png")
