"""The page of a sweep: frames to scrub through, the probe's path with the image planes, timing, dropped frames.

One HTML file with everything in it: scripts, pictures and plots.
"""

from __future__ import annotations

import base64
import io
from html import escape
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.outcome import Progress
from experiments.reporting.view_page import BADGE_STYLE, TURNING, badge, script_json
from experiments.studies.inspect_sweep.figures import (
    evenly,
    far_poses,
    intervals_figure,
    space_figure,
    timeline_figure,
)
from registration import transforms

if TYPE_CHECKING:
    import pandas as pd

    from registration.sweep import PosedFrames, TrackedSweep

_JPEG_QUALITY = 80
_HEIGHTS = {"space": "560px", "intervals": "300px", "timeline": "260px"}


def page(
    name: str,
    sweep: TrackedSweep,
    posed: PosedFrames,
    reasons: np.ndarray,
    table: pd.DataFrame,
    shown_frames: int,
    shown_px: int,
    progress: Progress,
) -> str:
    """Make the whole HTML page.

    Parameters
    ----------
    name : str
        Name of the sweep.
    sweep : TrackedSweep
        Tracked sweep.
    posed : PosedFrames
        Frames with a pose.
    reasons : ndarray, shape (n,)
        Why each frame has no pose; empty where it has one.
    table : pandas.DataFrame
        Summary of the sweep: columns of what and value.
    shown_frames : int
        Maximum number of frames in the page, evenly chosen.
    shown_px : int
        Larger side of the frames in the page in px.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    str
        The page as text.
    """
    corners_mm = _corners_mm(sweep, posed)
    shown = evenly(len(sweep.images), shown_frames)
    viewer = [
        _viewed(sweep, posed, reasons, corners_mm, frame, shown_px)
        for frame in progress.track(shown.tolist(), "frames", total=len(shown))
    ]
    rows = (f"<tr><th>{escape(what)}</th><td>{escape(value)}</td></tr>" for what, value in table.values)
    far = far_poses(sweep)
    return _PAGE.substitute(
        name=escape(name),
        badge=_badge(posed),
        badge_style=BADGE_STYLE,
        turning=TURNING,
        rows="\n".join(rows),
        far="1 pose lies" if far == 1 else f"{far} poses lie",
        far_hidden="" if far else " hidden",
        frames=script_json(viewer),
        last=max(0, len(viewer) - 1),
        # The first plot brings the script of plotly.js along.
        space=_plot("space", space_figure(sweep, corners_mm), include_plotlyjs=True),
        intervals=_plot("intervals", intervals_figure(sweep)),
        timeline=_plot("timeline", timeline_figure(sweep, reasons)),
    )


def _plot(name: str, figure: Any, include_plotlyjs: bool = False) -> str:
    """An element of the page with the figure in it."""
    drawn: str = figure.to_html(
        {"responsive": True, "displayModeBar": False},
        full_html=False,
        include_plotlyjs=include_plotlyjs,
        div_id=name,
        default_height=_HEIGHTS[name],
    )
    return drawn


def _viewed(
    sweep: TrackedSweep,
    posed: PosedFrames,
    reasons: np.ndarray,
    corners_mm: np.ndarray,
    frame: int,
    shown_px: int,
) -> dict[str, Any]:
    """What the viewer shows of a frame: its picture, its caption, and its outline where it has a pose."""
    at = np.flatnonzero(posed.kept == frame)
    dropped = f", dropped: {reasons[frame]}" if reasons[frame] else ""
    return {
        "picture": _picture(sweep.images[frame], shown_px),
        "label": f"frame {frame}, {sweep.image_times_s[frame]:.4f} s{dropped}",
        "outline": corners_mm[at[0]].T.tolist() if len(at) else None,
    }


def _badge(posed: PosedFrames) -> str:
    """How many frames are of use, in a badge."""
    kept, dropped = len(posed.kept), posed.frames_dropped
    if not kept:
        return badge("no frame has a pose", "bad")
    if dropped:
        return badge(f"{dropped} of {kept + dropped} frames dropped", "doubt")
    return badge("all frames have a pose", "good")


def _picture(image: np.ndarray, shown_px: int) -> str:
    """A frame as the address of an embedded JPEG."""
    from PIL import Image

    picture = Image.fromarray(image)
    picture.thumbnail((shown_px, shown_px))
    stream = io.BytesIO()
    picture.save(stream, "JPEG", quality=_JPEG_QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode()


def _corners_mm(sweep: TrackedSweep, posed: PosedFrames) -> np.ndarray:
    """The closed outline (k, 5, 3) of every posed image in the world, from its first pixel around."""
    height, width = sweep.images.shape[1:]
    right, bottom = max(width - 1, 0), max(height - 1, 0)
    around = np.array(
        [[0, 0, 0], [right, 0, 0], [right, bottom, 0], [0, bottom, 0], [0, 0, 0]], dtype=np.float64
    )
    return np.array([transforms.apply(matrix, around) for matrix in posed.world_A_pixel]).reshape(-1, 5, 3)


_PAGE = Template("""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>Tracked sweep $name</title>
<style>
body { font-family: system-ui, sans-serif; margin: 1.2rem; color: #222; max-width: 1500px; }
h1 { font-size: 1.3rem; overflow-wrap: anywhere; } h2 { font-size: 1.05rem; margin: 1.2rem 0 .4rem; }
table { border-collapse: collapse; font-size: .9rem; } th { text-align: left; font-weight: 600; }
th, td { padding: .15rem .8rem .15rem 0; vertical-align: top; }
.pair { display: grid; grid-template-columns: minmax(0, 1fr) minmax(0, 1.4fr); gap: 1.2rem; }
#picture { width: 100%; max-height: 520px; object-fit: contain; background: #000; }
#scrub { width: 100%; height: 2rem; } #label { font-variant-numeric: tabular-nums; }
.below { color: #4a5563; font-size: .85rem; margin: .2rem 0; }
$badge_style
@media (max-width: 900px) { .pair { grid-template-columns: minmax(0, 1fr); gap: 0; } }
@media (max-width: 600px) { body { margin: .8rem; } h1 { font-size: 1.1rem; } }
</style></head><body>
<h1>Tracked sweep $name$badge</h1>
<table>$rows</table>
<div class="pair">
<div><h2>Frames</h2><img id="picture" alt="ultrasound frame">
<input id="scrub" type="range" min="0" max="$last" value="0" aria-label="frame"><div id="label"></div></div>
<div><h2>Probe path and image planes (world, mm)</h2>
<div id="turned" tabindex="0" role="application" aria-label="3-D view: arrow keys turn, plus and minus zoom">
$space</div>
<p class="below">Drag or use the arrow keys to turn, scroll or use + and - to zoom.<span$far_hidden>
$far outside the view. <button type="button" id="all">Show all</button></span></p></div>
</div>
<h2>Timing</h2>$intervals
<h2>Frames kept and dropped</h2>$timeline
<script>
$turning
turnable(document.getElementById("turned"), document.getElementById("space"));
const frames = $frames;
const scrub = document.getElementById("scrub");
function show() {
  const frame = frames[Number(scrub.value)];
  if (!frame) {
    document.getElementById("label").textContent = "no frames";
    document.getElementById("picture").hidden = scrub.hidden = true;
    return;
  }
  document.getElementById("picture").src = frame.picture;
  document.getElementById("label").textContent = frame.label;
  const [x, y, z] = frame.outline || [[], [], []];
  Plotly.restyle("space", {x: [x], y: [y], z: [z]}, [document.getElementById("space").data.length - 1]);
}
scrub.addEventListener("input", show);
show();
document.getElementById("all").addEventListener("click", () => Plotly.relayout("space",
  {"scene.xaxis.autorange": true, "scene.yaxis.autorange": true, "scene.zaxis.autorange": true}));
if (window.innerWidth < 600) {
  // Side by side the counts would be too narrow to read.
  const intervals = document.getElementById("intervals");
  intervals.style.height = intervals.parentNode.style.height = "460px";
  Plotly.relayout(intervals, {"xaxis.domain": [0, 1], "xaxis2.domain": [0, 1], "yaxis.domain": [0.64, 1],
    "yaxis2.domain": [0, 0.34], "annotations[0].x": 0.5, "annotations[1].x": 0.5, "annotations[1].y": 0.34})
    .then(() => Plotly.Plots.resize(intervals));
  const space = document.getElementById("space");
  Object.assign(space.layout.legend, {orientation: "h", x: 0, y: 1, yanchor: "bottom"});
  Object.assign(space.data[0].marker.colorbar, {orientation: "h", len: 0.9, x: 0.5, xanchor: "center", y: 0,
    yanchor: "top"});
  // Drawn afresh: a scale that is there does not turn.
  Plotly.newPlot(space, space.data, space.layout, {responsive: true, displayModeBar: false})
    .then(() => widened(space));
}
</script></body></html>
""")
