"""What a mask file's pixels mean as labels, whatever form a program gave it.

The rules, in this order. A grey value is a label as it is stored; with two values, 0 and the largest that the bits
allow, the image is black and white. A palette or colour image whose colours are all grey has these grey values. One
of two colours, of which one is black, is black and white too. A palette of other colours is a label map whose indices
are the labels, if its first entry is black and no colour stands for two labels: programs that sort a palette anew
leave the indices without meaning, but do not keep black first. What is transparent is background; where only the
transparency varies, the opaque part is the mask. White of a black-and-white image stands for 255 or 1, whichever
label the mask may hold. JPEG changes values: only a black-and-white mask survives it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Shaped, UInt8

from experiments.datasets.images.decoding import OPAQUE, Decoded
from experiments.errors import InputError

BINARY = frozenset({0, 1, 255})
# Of a mask in a JPEG file: at most so much of it may lie between dark and bright, where its meaning is unknown.
_UNCLEAR_SHARE = 0.05
_DARK, _BRIGHT = 64, 192


def label_values(
    path: Path, decoded: Decoded, vessel: Collection[int], others: Collection[int]
) -> Shaped[np.ndarray, "h w"]:
    """Return the label of each pixel, by the rules of this module.

    Parameters
    ----------
    path : Path
        The file, for the message.
    decoded : Decoded
        Its pixels.
    vessel : collection of int
        Labels of the vessel.
    others : collection of int
        Further labels that the image may hold.

    Returns
    -------
    ndarray, shape (h, w)
        Labels; those in neither list are for the caller to refuse.

    Raises
    ------
    InputError
        If the file has no meaning as labels: colours that no rule covers, half-transparent pixels, or a JPEG
        file that is not black and white.
    """
    known, white = {*vessel, *others}, _white(vessel, others)
    if decoded.lossy:
        return _from_lossy(path, decoded, white)
    if decoded.palette is not None:
        return _from_palette(path, decoded.values, decoded.palette, known, white)
    if decoded.alpha is not None:
        decoded = _without_alpha(path, decoded)
    if decoded.values.ndim == 3:
        return _from_colours(path, decoded.values, white)
    return _from_grey(decoded, known, white)


def _white(vessel: Collection[int], others: Collection[int]) -> int | None:
    """Return the label that white of a black-and-white image means; None where several are possible."""
    foreground = {*vessel, *others} - {0}
    if foreground <= BINARY:
        return next((label for label in (255, 1) if label in vessel), None)
    return next(iter(foreground)) if len(foreground) == 1 else None


def _from_grey(decoded: Decoded, known: Collection[int], white: int | None) -> np.ndarray:
    values, largest = decoded.values, decoded.largest
    if decoded.bits == 1:
        return np.where(values == 1, 1 if 1 in known or white is None else white, 0)
    # Of 8 bits, white is 255 and stays so: a mask of 0 and 255 where 1 is expected is another form than announced.
    if white is None or decoded.bits == 8 or decoded.bits > 16 or largest in known:
        return values
    black_and_white = bool(((values == 0) | (values == largest)).all())
    return np.where(values == largest, white, 0) if black_and_white else values


def _from_palette(
    path: Path, indices: np.ndarray, palette: np.ndarray, known: Collection[int], white: int | None
) -> np.ndarray:
    used = np.unique(indices)
    if len(np.unique(palette[used, :3], axis=0)) == 1 and len(np.unique(palette[used, 3])) > 1:
        _require_clear_or_opaque(path, palette[used, 3])
        return np.where(palette[indices, 3] == OPAQUE, OPAQUE if white is None else white, 0)
    _require_clear_or_opaque(path, palette[used, 3])
    colours = np.where(palette[:, 3:] == 0, 0, palette[:, :3])
    shown = colours[used]
    if _all_grey(shown) and set(shown[:, 0].tolist()) <= set(known):
        return np.asarray(colours[indices, 0])
    black = ~shown.any(axis=1)
    if white is not None and len(np.unique(shown[~black], axis=0)) <= 1:
        return np.where(colours[indices].any(axis=-1), white, 0)
    distinct = len(np.unique(shown, axis=0)) == len(used)
    if colours[0].any() or not distinct:
        raise InputError(
            f"{path}: expected a palette whose first colour is black and whose colours differ, so that its indices are "
            f"labels, received first colour {tuple(colours[0].tolist())} and {len(used)} entries in use; "
            "save the mask as a grey image whose values are the labels"
        )
    return indices


def _from_colours(path: Path, colours: np.ndarray, white: int | None) -> np.ndarray:
    if _all_grey(colours):
        return np.ascontiguousarray(colours[..., 0])
    drawn = colours.any(axis=-1)
    shown = colours[drawn]
    if white is not None and bool((shown == shown[0]).all()):
        return np.where(drawn, white, 0)
    found = np.unique(colours.reshape(-1, 3), axis=0)
    raise InputError(
        f"{path}: expected a mask in grey values, or in black and one colour, received {len(found)} colours "
        f"({', '.join(str(tuple(colour.tolist())) for colour in found[:3])}, ...); "
        "save it as a grey image whose values are the labels"
    )


def _from_lossy(path: Path, decoded: Decoded, white: int | None) -> np.ndarray:
    grey = _luma(decoded)
    unclear = float(((grey >= _DARK) & (grey < _BRIGHT)).mean())
    if white is None or unclear > _UNCLEAR_SHARE or (grey.any() and not (grey >= _BRIGHT).any()):
        raise InputError(
            f"{path}: expected labels in a file format that keeps values (PNG), or a black-and-white mask, received a "
            f"JPEG file with values up to {grey.max():.0f}, {100 * unclear:.0f} % of them neither dark nor bright"
        )
    return np.where(grey >= 128, white, 0)


def _luma(decoded: Decoded) -> np.ndarray:
    # The brightest channel: a red mask is as bright as a white one.
    return decoded.values.max(axis=-1) if decoded.values.ndim == 3 else decoded.values


def _without_alpha(path: Path, decoded: Decoded) -> Decoded:
    """Return the opacity as mask where nothing else varies; else transparent pixels as background."""
    alpha: UInt8[np.ndarray, "h w"] | None = decoded.alpha
    assert alpha is not None
    _require_clear_or_opaque(path, alpha)
    values = decoded.values
    # A colour that can't be seen says nothing.
    if bool((values == values[0, 0]).all()):
        return Decoded(np.where(alpha == OPAQUE, np.uint8(1), np.uint8(0)), bits=1)
    seen = values[alpha == OPAQUE]
    if len(seen) and bool((seen == seen[0]).all()) and not seen[0].any():
        raise InputError(
            f"{path}: expected a mask in colours or in transparency, received one that is black where it is opaque and "
            "coloured where it is transparent; save it without transparency"
        )
    clear = (alpha == 0)[..., None] if values.ndim == 3 else alpha == 0
    return replace(decoded, values=np.where(clear, values.dtype.type(0), values), alpha=None)


def _require_clear_or_opaque(path: Path, alpha: np.ndarray) -> None:
    if not bool(((alpha == 0) | (alpha == OPAQUE)).all()):
        value = int(alpha[(alpha != 0) & (alpha != OPAQUE)].flat[0])
        raise InputError(
            f"{path}: expected a mask with pixels either opaque or transparent, received an alpha of {value}; "
            "save it without transparency"
        )


def _all_grey(colours: np.ndarray) -> bool:
    return bool((colours == colours[..., :1]).all())
