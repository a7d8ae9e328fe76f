"""Figures of plotly, read back from the page that holds them."""

from __future__ import annotations

import base64
import json
import re
from typing import Any

import numpy as np


def figure_of(page: str, name: str) -> dict[str, Any]:
    """The data and layout of the figure drawn in the element ``name``."""
    match = re.search(rf'Plotly\.newPlot\(\s*"{name}",\s*', page)
    assert match is not None
    data, end = json.JSONDecoder().raw_decode(page, match.end())
    gap = re.compile(r",\s*").match(page, end)
    assert gap is not None
    layout, _ = json.JSONDecoder().raw_decode(page, gap.end())
    return {"data": data, "layout": layout}


def numbers(packed: dict[str, str]) -> np.ndarray:
    """An array that the page holds in binary."""
    return np.frombuffer(base64.b64decode(packed["bdata"]), dtype=f"<{packed['dtype']}")
