"""What a result says of itself: one screen, in which an array is its shape and a long list its length."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields
from typing import Any

COLUMNS = 100
# As many numbers of a small array, and entries of a list, are told one by one.
FEW = 6


def brief_repr(result: Any) -> str:
    """Describe a dataclass on one screen: ``__repr__`` of classes that hold arrays.

    Parameters
    ----------
    result : dataclass
        Result. Fields with ``repr=False`` are left out.

    Returns
    -------
    str
        One line where it fits into ``COLUMNS``, else a line for each field, cut at ``COLUMNS``.
    """
    name = type(result).__name__
    told = [f"{each.name}={brief_value(getattr(result, each.name))}" for each in fields(result) if each.repr]
    line = f"{name}({', '.join(told)})"
    if len(line) <= COLUMNS:
        return line
    return f"{name}(\n" + ",\n".join(_cut(f"    {each}", COLUMNS - 2) for each in told) + ")"


def brief_value(value: Any) -> str:
    """Describe one value on one line.

    Parameters
    ----------
    value : object
        Array, number, text, list, mapping, or anything with a representation.

    Returns
    -------
    str
        The line, at most ``COLUMNS`` long.
    """
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and shape:
        return _array(value, shape)
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, str):
        return repr(_cut(value, COLUMNS // 2))
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key}: {brief_value(each)}" for key, each in value.items())
        return f"{{{inner}}}" if len(inner) < COLUMNS // 2 else f"{len(value)} entries"
    if isinstance(value, Collection) and not hasattr(value, "__dataclass_fields__"):
        inner = ", ".join(map(brief_value, value)) if len(value) <= FEW else ""
        return f"({inner})" if value and 0 < len(inner) < COLUMNS // 2 else f"{len(value)} entries"
    lines = repr(value).splitlines() or [""]
    return lines[0] if len(lines) == 1 and len(lines[0]) <= COLUMNS // 2 else f"{type(value).__name__}(...)"


def _array(value: Any, shape: tuple[int, ...]) -> str:
    """Few numbers themselves, else the shape: with the type of its numbers, or as rows and columns of a table."""
    dtype = getattr(value, "dtype", None)
    if dtype is None:
        return " x ".join(map(str, shape))
    if len(shape) == 1 and 0 < shape[0] <= FEW:
        return f"[{', '.join(map(brief_value, value.tolist()))}]"
    return f"{shape} {dtype}"


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."
