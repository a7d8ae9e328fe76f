"""HTML around an interactive 3-D view: title, buttons of the layers, notes, and a view that the keyboard turns."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from string import Template
from typing import Any

# Colour scales by plotly's names, and the same as gradients of CSS.
VALUES_SCALE, RADIUS_SCALE = "Viridis", "Plasma"
_GRADIENTS = {
    VALUES_SCALE: "linear-gradient(90deg, #440154, #3b528b, #21918c, #5ec962, #fde725)",
    RADIUS_SCALE: "linear-gradient(90deg, #0d0887, #7e03a8, #cc4778, #f89540, #f0f921)",
}
# The look of a verdict; whatever is neither good nor failed is in doubt.
_BADGES = {"accepted": "good", "failed": "bad"}
BADGE_STYLE = """.badge { border-radius: 10px; padding: 2px 10px; font-size: .85rem; font-weight: 600;
  white-space: nowrap; }
.good { background: #d9f2e3; color: #0d5a2c; } .doubt { background: #fdeccf; color: #6d4300; }
.bad { background: #f9d9d7; color: #7d1611; }
:focus-visible { outline: 3px solid #f2a900; outline-offset: -3px; }"""
# Arrow keys turn the plot, plus and minus zoom; a frame that is higher than wide sees less to the sides.
TURNING = """
function narrowness(plot) { const frame = plot._fullLayout._size; return Math.max(1, frame.h / frame.w); }
function widened(plot) {
  const eye = plot.layout.scene.camera.eye, times = narrowness(plot);
  return Plotly.relayout(plot, {"scene.camera.eye": {x: times * eye.x, y: times * eye.y, z: times * eye.z}});
}
function turnable(frame, plot) {
  const turns = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]};
  const zooms = {"+": 0.9, "=": 0.9, "-": 1 / 0.9};
  frame.addEventListener("keydown", function (event) {
    const turn = turns[event.key], zoom = zooms[event.key] || 1;
    if (event.target !== frame || event.ctrlKey || event.metaKey || (!turn && zoom === 1)) return;
    event.preventDefault();
    const eye = plot.layout.scene.camera.eye, step = Math.PI / 18;
    const far = Math.hypot(eye.x, eye.y, eye.z);
    const around = Math.atan2(eye.y, eye.x) + step * (turn ? turn[0] : 0);
    // Not over the poles, where left and right would change places.
    const up = Math.max(-1.5, Math.min(1.5, Math.asin(eye.z / far) + step * (turn ? turn[1] : 0)));
    Plotly.relayout(plot, {"scene.camera.eye": {
      x: far * zoom * Math.cos(up) * Math.cos(around),
      y: far * zoom * Math.cos(up) * Math.sin(around), z: far * zoom * Math.sin(up)}});
  });
}
"""


def badge(text: str, kind: str | None = None) -> str:
    """Make a badge for the title.

    Parameters
    ----------
    text : str
        Verdict or another short statement; empty for no badge.
    kind : {'good', 'doubt', 'bad'} or None, optional
        Its look; None for that of the verdict.

    Returns
    -------
    str
        HTML; empty without a text.
    """
    look = kind or _BADGES.get(text, "doubt")
    return f' <span class="badge {look}">{escape(text)}</span>' if text else ""


def layer_button(name: str, color: str, shown: bool) -> str:
    """Make the button that switches a layer.

    Parameters
    ----------
    name : str
        Name of the layer.
    color : str
        Colour of CSS, or the name of a colour scale.
    shown : bool
        Whether the layer is visible at first.

    Returns
    -------
    str
        HTML.
    """
    look = escape(_GRADIENTS.get(color, color))
    pressed = "true" if shown else "false"
    return (
        f'<button type="button" class="layer" aria-pressed="{pressed}">'
        f'<span class="swatch" style="background: {look}"></span>{escape(name)}</button>'
    )


def script_json(value: Any) -> str:
    """Write JSON that can stand inside a script element whatever text it holds.

    Parameters
    ----------
    value : object
        Plain data.

    Returns
    -------
    str
        The JSON.
    """
    return json.dumps(value).replace("</", "<\\/")


def scene_html(
    title: str, verdict: str, buttons: Sequence[str], notes: Sequence[str], view: str, fitting: dict[str, Any]
) -> str:
    """Put the page together.

    Parameters
    ----------
    title : str
        Title.
    verdict : str
        Verdict shown as a badge; empty for none.
    buttons : sequence of str
        HTML of the buttons, one a layer in their order.
    notes : sequence of str
        Sentences below the view.
    view : str
        HTML of the plot, whose element is called ``scene``.
    fitting : dict
        What fits the view: ``boxes`` (lowest and highest coordinates of each layer in mm), ``whole`` (the same with
        outliers), ``outliers`` (their number), ``direction`` and ``distance`` of the view.

    Returns
    -------
    str
        The page.
    """
    return _PAGE.substitute(
        title=escape(title),
        badge=badge(verdict),
        badge_style=BADGE_STYLE,
        buttons="\n".join(buttons),
        outliers="" if fitting["outliers"] else " hidden",
        notes="\n".join(f"<p>{escape(note)}</p>" for note in notes),
        view=view,
        fitting=script_json(fitting),
        turning=TURNING,
    )


_PAGE = Template("""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
html, body { height: 100%; } body { display: flex; flex-direction: column; margin: 0; background: #fff; color: #222;
  font-family: system-ui, sans-serif; }
h1 { font-size: 1.2rem; margin: .7rem 1rem .3rem; overflow-wrap: anywhere; }
#controls { display: flex; flex-wrap: wrap; gap: .3rem; margin: 0 1rem .3rem; }
button { font: inherit; font-size: .82rem; line-height: 1.3; padding: .22rem .6rem; border: 1px solid #b8c0ca;
  border-radius: 6px; background: #fff; color: inherit; cursor: pointer; text-align: left; overflow-wrap: anywhere; }
button:hover { background: #eef2f6; }
.layer[aria-pressed="false"] { color: #5b6570; border-style: dashed; }
.layer[aria-pressed="false"] .swatch { opacity: .25; }
.swatch { display: inline-block; width: 1.1em; height: .8em; border-radius: 3px; margin-right: .4em; }
.action { background: #f1f4f7; }
/* The notes come first in the text, so that the view is drawn at the height that they leave. */
#view { flex: 1; min-height: 380px; order: 1; } #view > div { height: 100%; }
$badge_style
#notes { order: 2; margin: .2rem 1rem .6rem; font-size: .85rem; line-height: 1.4; } #notes p { margin: .15rem 0; }
@media (max-width: 600px) { h1 { font-size: 1rem; margin: .6rem .7rem .3rem; }
  #controls, #notes { margin-left: .7rem; margin-right: .7rem; } }
</style></head><body>
<h1>$title$badge</h1>
<div id="controls" role="group" aria-label="Layers and view">
$buttons
<button type="button" class="action" id="fit">Fit view</button>
<button type="button" class="action" id="all"$outliers>Show outliers</button>
<button type="button" class="action" id="save">Save picture</button></div>
<div id="notes">$notes<p>Drag or use the arrow keys to turn, scroll or use + and - to zoom; the buttons switch
layers.</p></div>
<div id="view" tabindex="0" role="application" aria-label="3-D view: arrow keys turn, plus and minus zoom">$view</div>
<script>
$turning
const plot = document.getElementById("scene"), fitting = $fitting;
const layers = Array.from(document.querySelectorAll(".layer"));
function shown() { return layers.map((_, at) => at).filter(at => layers[at].ariaPressed === "true"); }
// The ranges of the axes that hold boxes, a little wider than these.
function ranges(boxes) {
  const low = [0, 1, 2].map(at => Math.min(...boxes.map(box => box[0][at])));
  const high = [0, 1, 2].map(at => Math.max(...boxes.map(box => box[1][at])));
  const margin = 0.03 * Math.max(...low.map((value, at) => high[at] - value)) + 1e-6;
  return low.map((value, at) => [value - margin, high[at] + margin]);
}
function looked(axes) {
  const sides = axes.map(range => range[1] - range[0]);
  const scale = Math.cbrt(sides[0] * sides[1] * sides[2]);
  const far = fitting.distance * Math.hypot(...sides) / scale / 2 * narrowness(plot);
  const change = {"scene.camera.eye": {x: far * fitting.direction[0], y: far * fitting.direction[1],
    z: far * fitting.direction[2]}};
  ["x", "y", "z"].forEach((axis, at) => { change["scene." + axis + "axis.range"] = axes[at]; });
  return Plotly.relayout(plot, change);
}
function fit(boxes) { const chosen = shown().map(at => boxes[at]); if (chosen.length) looked(ranges(chosen)); }
layers.forEach(function (button, at) {
  button.addEventListener("click", function () {
    const on = button.ariaPressed !== "true";
    button.ariaPressed = String(on);
    Plotly.restyle(plot, {visible: on ? true : "legendonly"}, [at]);
    // The view stays as it is unless it would cut off the layer.
    const now = ["x", "y", "z"].map(axis => plot.layout.scene[axis + "axis"].range);
    const [low, high] = fitting.boxes[at];
    const cut = now.some((range, axis) => low[axis] < range[0] || high[axis] > range[1]);
    if (on && cut) fit(fitting.boxes);
  });
});
document.getElementById("fit").addEventListener("click", () => fit(fitting.boxes));
document.getElementById("all").addEventListener("click", () => fit(fitting.whole));
const save = document.getElementById("save");
// Inside another page a browser refuses to save.
save.hidden = window.top !== window.self;
save.addEventListener("click", () => Plotly.downloadImage(plot, {format: "png", filename: document.title}));
turnable(document.getElementById("view"), plot);
// On a narrow screen the colour scales lie below and above the view, which is seen from farther away.
if (window.innerWidth < 600) {
  const layout = plot.layout;
  layout.font.size = 11;
  ["xaxis", "yaxis", "zaxis"].forEach(name => { layout.scene[name].nticks = 5; });
  ["coloraxis", "coloraxis2"].filter(name => layout[name]).forEach(function (name, at) {
    const bar = layout[name].colorbar;
    Object.assign(bar, {orientation: "h", len: 0.9, thickness: 12, x: 0.5, xanchor: "center", ypad: 4,
      y: at ? 1 : 0, yanchor: at ? "bottom" : "top", title: {text: bar.title.text, side: "top"}});
  });
  // Drawn afresh: a scale that is there does not turn.
  Plotly.newPlot(plot, plot.data, layout, {responsive: true, displayModeBar: false})
    .then(() => widened(plot));
}
</script>
</body></html>
""")
