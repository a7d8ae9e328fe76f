"""What is reported of a centerline: its metrics, and a row a line or a point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from registration.geometry.shapes import Centerline

if TYPE_CHECKING:
    import pandas as pd


def metrics(found: Centerline) -> dict[str, float]:
    """Compute the scalars for the tracker.

    Parameters
    ----------
    found : Centerline
        Centerline.

    Returns
    -------
    dict
        Number of lines, length and radii in mm by metric name.
    """
    radius_mm = np.concatenate([line.radius_mm for line in found.lines])
    return {
        "lines": float(len(found.lines)),
        "length_mm": found.length_mm,
        "radius_min_mm": float(radius_mm.min()),
        "radius_median_mm": float(np.median(radius_mm)),
        "radius_max_mm": float(radius_mm.max()),
    }


def table(found: Centerline) -> pd.DataFrame:
    """Tabulate the lines.

    Parameters
    ----------
    found : Centerline
        Centerline.

    Returns
    -------
    pandas.DataFrame
        One row per line with its length and radii in mm.
    """
    import pandas as pd

    return pd.DataFrame(
        [
            {
                "line": number,
                "length_mm": line.length_mm,
                "radius_min_mm": float(line.radius_mm.min()),
                "radius_median_mm": float(np.median(line.radius_mm)),
                "radius_max_mm": float(line.radius_mm.max()),
            }
            for number, line in enumerate(found.lines)
        ]
    )


def cases(found: Centerline) -> pd.DataFrame:
    """Tabulate the points.

    Parameters
    ----------
    found : Centerline
        Centerline.

    Returns
    -------
    pandas.DataFrame
        One row per point, in order along each line, with arc length, position and radius in mm.
    """
    import pandas as pd

    parts = [
        pd.DataFrame(
            {
                "line": number,
                "arc_mm": line.arc_mm,
                **{f"{axis}_mm": line.points_mm[:, place] for place, axis in enumerate("xyz")},
                "radius_mm": line.radius_mm,
            }
        )
        for number, line in enumerate(found.lines)
    ]
    return pd.concat(parts, ignore_index=True)
