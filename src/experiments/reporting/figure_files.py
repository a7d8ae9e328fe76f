"""Files of figures, in which every name is shown as it is.

Studies draw with matplotlib and hand the figure over; the formats are the same for all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


# The same figure is the same file, whenever it is drawn.
_WITHOUT_DATE: dict[str, dict[str, None]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def save_figure(figure: Figure, stem: Path, suffixes: Sequence[str] = ("png", "svg"), dpi: int = 150) -> None:
    """Write a figure to ``<stem>.<suffix>`` for each suffix.

    Names of cases, models and files are plain text: two dollar signs in one would otherwise begin and end a
    formula, which is shown as another text or ends the drawing. No figure of this project has formulas.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Figure to write; its text is set to plain text.
    stem : Path
        Path without suffix.
    suffixes : sequence of str, optional
        Formats.
    dpi : int, optional
        Resolution of raster formats.
    """
    import matplotlib
    from matplotlib.text import Text

    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            _plain_numbers(axis)
    for text in figure.findobj(Text):
        text.set_parse_math(False)
    # Ticks that are only made while drawing take it from here; the salt gives parts of an SVG the same ids each time.
    # Without the two of the layout no engine means none.
    with matplotlib.rc_context(
        {
            "text.parse_math": False,
            "svg.hashsalt": "ctus",
            "figure.autolayout": False,
            "figure.constrained_layout.use": False,
        }
    ):
        engine, own_dpi = figure.get_layout_engine(), figure.dpi
        figure.dpi = dpi
        # Laid out and measured once: each format would draw all of it a second time for that.
        figure.draw_without_rendering()
        shown = figure.get_tightbbox().padded(float(matplotlib.rcParams["savefig.pad_inches"]))
        figure.set_layout_engine(None)
        for suffix in suffixes:
            place = stem.with_name(f"{stem.name}.{suffix}")
            figure.savefig(place, dpi=dpi, bbox_inches=shown, metadata=_WITHOUT_DATE.get(suffix))
        figure.set_layout_engine(engine)
        figure.dpi = own_dpi


def _plain_numbers(axis: Axis) -> None:
    """Write the numbers of a logarithmic axis without a formula, which is what matplotlib makes of them."""
    from matplotlib.ticker import FuncFormatter, LogFormatter, NullFormatter

    plain = FuncFormatter(lambda value, _: f"{value:g}")
    if isinstance(axis.get_major_formatter(), LogFormatter):
        axis.set_major_formatter(plain)
    if isinstance(axis.get_minor_formatter(), LogFormatter):
        first, last = sorted(axis.get_view_interval())
        within_a_decade = first > 0 and last < 10 * first
        axis.set_minor_formatter(plain if within_a_decade else NullFormatter())
