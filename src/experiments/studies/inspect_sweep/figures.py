"""The plots of a sweep's page: the probe's path with the image planes, intervals, and what became of each frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.reporting.labels import axis_label
from experiments.reporting.scene_data import VIEW_CENTER, core_bounds_of, view_eye

if TYPE_CHECKING:
    import plotly.graph_objects as go  # type: ignore[import-untyped]

    from registration.sweep import TrackedSweep

# So many outlines of image planes still let the path be seen.
_MAX_PLANES = 40
_BAR = {"title": axis_label("time_s"), "len": 0.7, "y": 0.4, "thickness": 14}
_KEPT, _DROPPED, _CHOSEN = "#2a6f97", "#d1495b", "#f2a541"


def evenly(count: int, max_count: int) -> np.ndarray:
    """Choose indices evenly, first and last among them.

    Parameters
    ----------
    count : int
        Number of things to choose from.
    max_count : int
        Maximum number of indices.

    Returns
    -------
    ndarray of int
        The indices.
    """
    return np.unique(np.linspace(0, count - 1, min(max_count, count)).round().astype(int))


def space_figure(sweep: TrackedSweep, corners_mm: np.ndarray) -> go.Figure:
    """Draw the end effector's path and image planes; the last trace is the plane of the frame that is looked at.

    Parameters
    ----------
    sweep : TrackedSweep
        Tracked sweep.
    corners_mm : ndarray, shape (k, 5, 3)
        Closed outline of every image with a pose, in the world frame in mm.

    Returns
    -------
    plotly.graph_objects.Figure
        The figure.
    """
    import plotly.graph_objects as go

    path = sweep.world_T_ee[:, :3, 3]
    some = evenly(len(corners_mm), _MAX_PLANES)
    gaps = np.full((len(some), 1, 3), np.nan)
    planes = np.concatenate([corners_mm[some], gaps], axis=1).reshape(-1, 3)
    figure = go.Figure()
    elapsed_s = sweep.pose_times_s - sweep.pose_times_s[:1]
    figure.add_scatter3d(
        **_xyz(path),
        mode="lines+markers",
        name="end effector",
        marker={"size": 2, "color": elapsed_s, "colorscale": "Viridis", "colorbar": _BAR},
        line={"color": "#888888", "width": 2},
    )
    figure.add_scatter3d(**_xyz(planes), mode="lines", name="image planes", line={"color": _KEPT, "width": 1})
    figure.add_scatter3d(
        **_xyz(corners_mm[:1].reshape(-1, 3)),
        mode="lines",
        name="this frame",
        line={"color": _CHOSEN, "width": 7},
    )
    figure.update_layout(
        scene=_fitted_scene(path, corners_mm),
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        # Entries say what is what; they switch nothing, so that the keyboard misses nothing.
        legend={"x": 0, "y": 1, "itemclick": False, "itemdoubleclick": False},
    )
    return figure


def _fitted_scene(path_mm: np.ndarray, corners_mm: np.ndarray) -> dict[str, Any]:
    """Axes and camera that show path and image planes."""
    low_mm, high_mm = _fitted_mm(path_mm, corners_mm)
    axes = {
        f"{axis}axis": {
            "title": axis_label(f"{axis}_mm"),
            "range": [float(low_mm[at]), float(high_mm[at])],
            "nticks": 6,
        }
        for at, axis in enumerate("xyz")
    }
    camera = {"eye": view_eye(high_mm - low_mm), "center": VIEW_CENTER}
    return {"aspectmode": "data", "camera": camera, **axes}


def far_poses(sweep: TrackedSweep) -> int:
    """Count the poses that lie far away from all others, which the view of the path is not fitted to.

    Parameters
    ----------
    sweep : TrackedSweep
        Tracked sweep.

    Returns
    -------
    int
        Number of poses.
    """
    return core_bounds_of(sweep.world_T_ee[:, :3, 3])[1] if len(sweep.world_T_ee) else 0


def _fitted_mm(path_mm: np.ndarray, corners_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and highest coordinates of the view: path and image planes, without single ones far away."""
    drawn = [points_mm for points_mm in (path_mm, corners_mm.reshape(-1, 3)) if len(points_mm)]
    if not drawn:
        return np.zeros(3), np.ones(3)
    bounds_mm = np.stack([core_bounds_of(points_mm)[0] for points_mm in drawn])
    low_mm, high_mm = bounds_mm[:, 0].min(axis=0), bounds_mm[:, 1].max(axis=0)
    margin_mm = 0.03 * float((high_mm - low_mm).max()) + 1e-3
    return low_mm - margin_mm, high_mm + margin_mm


def intervals_figure(sweep: TrackedSweep) -> go.Figure:
    """Draw how far apart in time frames and poses are.

    Parameters
    ----------
    sweep : TrackedSweep
        Tracked sweep.

    Returns
    -------
    plotly.graph_objects.Figure
        The figure.
    """
    from plotly.subplots import make_subplots  # type: ignore[import-untyped]

    figure = make_subplots(rows=1, cols=2, subplot_titles=("between frames", "between poses"))
    for column, times_s in enumerate((sweep.image_times_s, sweep.pose_times_s), start=1):
        # Clocks are read to a microsecond at best: finer differences are rounding.
        intervals_ms = np.diff(times_s).round(6) * 1e3
        low_ms, high_ms = (intervals_ms.min(), intervals_ms.max()) if len(intervals_ms) else (0.0, 1.0)
        # A steady clock gives one bar, which needs room on both sides to be seen.
        margin_ms = max(0.05 * (high_ms - low_ms), 0.05 * high_ms)
        counts, edges_ms = np.histogram(
            intervals_ms, bins=60, range=(low_ms - margin_ms, high_ms + margin_ms)
        )
        centres_ms = (edges_ms[:-1] + edges_ms[1:]) / 2
        figure.add_bar(
            x=centres_ms, y=counts, width=float(edges_ms[1] - edges_ms[0]),
            marker_color=_KEPT, row=1, col=column,
        )  # fmt: skip
        figure.update_xaxes(title=axis_label("interval_ms"), row=1, col=column)
        figure.update_yaxes(title="Count", type="log", dtick=1, row=1, col=column)
    figure.update_layout(showlegend=False, margin={"l": 50, "r": 10, "t": 30, "b": 40})
    return figure


def timeline_figure(sweep: TrackedSweep, reasons: np.ndarray) -> go.Figure:
    """Draw when each frame was taken and what became of it, with the poses below.

    Parameters
    ----------
    sweep : TrackedSweep
        Tracked sweep.
    reasons : ndarray, shape (n,)
        Why each frame has no pose; empty where it has one.

    Returns
    -------
    plotly.graph_objects.Figure
        The figure.
    """
    import plotly.graph_objects as go

    figure = go.Figure()
    start_s = min([*sweep.image_times_s[:1], *sweep.pose_times_s[:1]])
    for reason in ["", *sorted({str(reason) for reason in reasons} - {""})]:
        chosen = reasons == reason
        label = f"dropped: {reason}" if reason else "frames with a pose"
        figure.add_scatter(
            x=sweep.image_times_s[chosen] - start_s,
            y=[label] * int(chosen.sum()),
            mode="markers",
            name=label,
            marker={"color": _DROPPED if reason else _KEPT, "symbol": "line-ns-open", "size": 10},
        )
    figure.add_scatter(
        x=sweep.pose_times_s - start_s,
        y=["poses"] * len(sweep.pose_times_s),
        mode="markers",
        name="poses",
        marker={"color": "#888888", "symbol": "line-ns-open", "size": 10},
    )
    figure.update_xaxes(title=axis_label("time_s"))
    figure.update_layout(showlegend=False, margin={"l": 10, "r": 10, "t": 10, "b": 40})
    figure.update_yaxes(automargin=True)
    return figure


def _xyz(points_mm: np.ndarray) -> dict[str, np.ndarray]:
    """Coordinates in single precision, which plotly stores in binary; NaN breaks a line."""
    return dict(zip("xyz", points_mm.T.astype(np.float32), strict=True))
