"""Small pictures of clouds for notebooks: one on another by its distance, and a surface; SVG, without a library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

WIDTH_PX, MARGIN_PX, TITLE_PX = 260, 8, 34
# More points add bytes to a notebook and nothing to see.
POINTS = 1500
# Viridis at nine even places, and what stays.
COLORS = (
    "#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725",
)  # fmt: skip
BACKGROUND = "#b8bcc2"
# The colours end where this share of the distances does.
PERCENTILE = 99.0


@dataclass(frozen=True)
class Stage:
    """One stage of a registration: where both clouds lie in one frame.

    Parameters
    ----------
    name : str
        Name above its picture.
    moving_mm : ndarray, shape (n, 3)
        Cloud that moves, in mm.
    fixed_mm : ndarray, shape (m, 3)
        Cloud that it is laid on, in mm.
    """

    name: str
    moving_mm: Float64[np.ndarray, "n 3"]
    fixed_mm: Float64[np.ndarray, "m 3"]

    @property
    def distance_mm(self) -> Float64[np.ndarray, " n"]:
        """Distance of each moving point to the nearest fixed point in mm."""
        return np.asarray(cKDTree(self.fixed_mm).query(self.moving_mm)[0])

    @property
    def rms_mm(self) -> float:
        """Root mean square of the distances in mm."""
        return float(np.sqrt(np.mean(self.distance_mm**2)))


@dataclass(frozen=True)
class Overlay:
    """One cloud on another at each stage of a registration; a notebook shows it by distance.

    Parameters
    ----------
    stages : tuple of Stage
        Stages in their order.
    """

    stages: tuple[Stage, ...]

    def __repr__(self) -> str:
        """A stage and its residual, which is no error, a line."""
        told = ",\n    ".join(f"{stage.name}: RMS {stage.rms_mm:.2f} mm" for stage in self.stages)
        return f"Overlay({told})"

    def _repr_html_(self) -> str:
        distances = [stage.distance_mm for stage in self.stages]
        if not distances:
            return escape(repr(self))
        # The last stage sets the scale: what lies far away before it has the last colour.
        end_mm = max(float(np.percentile(distances[-1], PERCENTILE)), 1e-3)
        frame = _view([stage.fixed_mm for stage in self.stages] + [self.stages[-1].moving_mm])
        panels = []
        for stage, distance_mm in zip(self.stages, distances, strict=True):
            title = f"{stage.name}: RMS {np.sqrt(np.mean(distance_mm**2)):.2f} mm"
            layers = [(stage.fixed_mm, None), (stage.moving_mm, distance_mm / end_mm)]
            panels.append(_svg(title, frame, layers))
        return (
            f"<div>{''.join(panels)}</div><small>Colour: distance to the nearest grey point, 0 (dark) to "
            f"{end_mm:.2f} mm (yellow).</small>"
        )


def surface_picture(title: str, points_mm: Float64[np.ndarray, "n 3"]) -> str:
    """Draw a surface from the side, coloured by depth.

    Parameters
    ----------
    title : str
        Title above it.
    points_mm : ndarray, shape (n, 3)
        Its points in mm.

    Returns
    -------
    str
        HTML.
    """
    if not len(points_mm):
        return escape(title)
    frame = _view([points_mm])
    depth_mm = (points_mm - frame.centre_mm) @ frame.axes[2]
    span_mm = max(float(np.ptp(depth_mm)), 1e-9)
    return f"<div>{_svg(title, frame, [(points_mm, (depth_mm - depth_mm.min()) / span_mm)])}</div>"


@dataclass(frozen=True)
class _View:
    """Axes to look along and what the picture holds: the longest axis goes up, so that vessels fill it."""

    centre_mm: np.ndarray
    axes: np.ndarray
    half_mm: np.ndarray

    @property
    def px_per_mm(self) -> float:
        return (WIDTH_PX - 2 * MARGIN_PX) / (2 * float(self.half_mm.max()))


def _view(clouds: Sequence[np.ndarray]) -> _View:
    points_mm = np.concatenate(clouds)
    centre_mm = points_mm.mean(axis=0)
    axes = np.linalg.svd(_few(points_mm) - centre_mm, full_matrices=False)[2]
    flat_mm = np.abs((points_mm - centre_mm) @ axes[:2].T)
    return _View(centre_mm, axes, np.maximum(flat_mm.max(axis=0), 1e-6))


def _svg(title: str, view: _View, layers: Sequence[tuple[np.ndarray, np.ndarray | None]]) -> str:
    """Points as dots of round-capped strokes, a path a colour, which takes a third of the bytes of circles."""
    drawn = []
    for points_mm, shares in layers:
        flat = (_few(points_mm) - view.centre_mm) @ view.axes[:2].T * view.px_per_mm + WIDTH_PX / 2
        if shares is None:
            drawn.append(_dots(flat, BACKGROUND, 2.0))
            continue
        place = np.clip(_few(shares) * len(COLORS), 0, len(COLORS) - 1).astype(int)
        drawn += [
            _dots(flat[place == at], color, 2.6) for at, color in enumerate(COLORS) if (place == at).any()
        ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH_PX}" height="{WIDTH_PX + TITLE_PX}" role="img">'
        f"<title>{escape(title)}</title>"
        f'<text x="{MARGIN_PX}" y="20" font-family="sans-serif" font-size="12">{escape(title)}</text>'
        f'<g transform="translate(0 {TITLE_PX})" stroke-linecap="round" fill="none">{"".join(drawn)}</g></svg>'
    )


def _dots(flat: np.ndarray, color: str, size_px: float) -> str:
    inside = flat[((flat > 0) & (flat < WIDTH_PX)).all(axis=1)]
    path = "".join(f"M{right:.1f} {up:.1f}h0" for up, right in inside.tolist())
    return f'<path stroke="{color}" stroke-width="{size_px}" d="{path}"/>' if path else ""


def _few(values: np.ndarray) -> np.ndarray:
    """Every so many-th of them, so that there are no more than ``POINTS``."""
    return values[:: max(1, -(-len(values) // POINTS))]
