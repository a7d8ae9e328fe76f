"""The page of a report: one file with every table, figure and scene, and where each number comes from."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from experiments.running.terminal import cell_text
from experiments.studies.report.page_template import PAGE, TABLE
from experiments.studies.report.published_table import NOT_MEASURED, YES

if TYPE_CHECKING:
    import pandas as pd

TITLE = "Registration of vessels from ultrasound: results"
TABLE_FILES = ("csv", "md", "tex")
# Cells of the column ``comparable`` are shown as badges.
BADGE_COLUMN = "comparable"


@dataclass(frozen=True)
class ShownTable:
    """A table with its place among the files.

    Parameters
    ----------
    title : str
        Heading.
    frame : pandas.DataFrame
        The table.
    stem : str, optional
        Path of its files from the page on, without suffix; empty where it has none.
    note : str, optional
        What stands below it.
    """

    title: str
    frame: pd.DataFrame
    stem: str = ""
    note: str = ""


@dataclass(frozen=True)
class ShownFigure:
    """A figure with its place among the files.

    Parameters
    ----------
    alt : str
        What it shows, in a few words.
    stem : str
        Path of its files from the page on, without suffix.
    png : bytes
        The figure as PNG.
    """

    alt: str
    stem: str
    png: bytes


@dataclass(frozen=True)
class ShownSection:
    """A section of the page.

    Parameters
    ----------
    title : str
        Heading.
    anchor : str
        Its id within the page.
    source : str
        Which run it shows.
    tables : tuple of ShownTable, optional
        Tables.
    figures : tuple of ShownFigure, optional
        Figures.
    findings : tuple of str, optional
        Plain sentences.
    scenes : Mapping[str, str], optional
        Pages with a 3-D view, by title.
    failure : str, optional
        Why there is nothing to show; empty if there is.
    """

    title: str
    anchor: str
    source: str
    tables: tuple[ShownTable, ...] = ()
    figures: tuple[ShownFigure, ...] = ()
    findings: tuple[str, ...] = ()
    scenes: Mapping[str, str] = field(default_factory=dict)
    failure: str = ""


def page(
    published: ShownTable, sections: Sequence[ShownSection], origin: ShownTable, runs: ShownTable, made: str
) -> str:
    """Write the page.

    Parameters
    ----------
    published : ShownTable
        Published values beside measured ones.
    sections : sequence of ShownSection
        A section for each sweep.
    origin : ShownTable
        Where the numbers of each section come from.
    runs : ShownTable
        Every run that counts.
    made : str
        What made the page.

    Returns
    -------
    str
        HTML; every text in it is shown as it is, whatever characters it has.
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    shown_table = environment.from_string(TABLE)
    return environment.from_string(PAGE).render(
        title=TITLE,
        made=made,
        counted=_counted(published.frame),
        published=_published(published),
        sections=[_section(section) for section in sections],
        origin=_table(origin),
        runs=_table(runs),
        # The template's own output; the texts in it are escaped by then.
        table=lambda one: Markup(shown_table.render(one=one)),
    )


def _counted(published: pd.DataFrame) -> str:
    values = published.drop_duplicates(["study", "value", "published", "published_on"])
    measured = published[published[BADGE_COLUMN] != NOT_MEASURED]
    comparable = measured[measured[BADGE_COLUMN] == YES]
    reached = int((comparable["difference"] == "in range").sum())
    return (
        f"{len(values)} published values and sentences; {len(measured)} measurements stand beside them, "
        f"{len(comparable)} of which on comparable data, {reached} of these in the published range. A row without a "
        "run names the command that makes it."
    )


def _published(one: ShownTable) -> dict[str, Any]:
    """The published values in few columns, each with its details in a second line."""
    rows = []
    for row in one.frame.to_dict("records"):
        command = row["command"] if row["comparable"] == NOT_MEASURED else ""
        rows.append(
            [
                _cell(f"{row['study']}: {row['value']}".replace("_", " "), row["place"]),
                _cell(row["published"], row["published_on"]),
                _cell(row["ours"], row["interval"]),
                _cell(row["measured_on"] or command, row["n"], code=bool(command)),
                _cell(row[BADGE_COLUMN], row["difference"], badge=_badge(BADGE_COLUMN, row[BADGE_COLUMN])),
                _cell(row["said"]),
                _cell(row["run"], row["budget"], code=True),
            ]
        )
    columns = ["value", "published", "ours", "measured on, or command", "comparable", "in words", "run"]
    return {**_table(one), "columns": columns, "rows": rows}


def _cell(
    text: str, below: str = "", badge: str = "", *, code: bool = False, number: bool = False
) -> dict[str, Any]:
    return {"text": text, "below": below, "badge": badge, "code": code, "number": number}


def _section(section: ShownSection) -> dict[str, Any]:
    return {
        "title": section.title,
        "anchor": section.anchor,
        "source": section.source,
        "failure": section.failure,
        "findings": section.findings,
        "tables": [_table(one) for one in section.tables],
        "figures": [
            {"alt": one.alt, "stem": one.stem, "data": f"data:image/png;base64,{_base64(one.png)}"}
            for one in section.figures
        ],
        "scenes": [{"title": title, "html": html} for title, html in section.scenes.items()],
    }


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


def _table(one: ShownTable) -> dict[str, Any]:
    numeric = [one.frame[name].dtype.kind in "if" for name in one.frame.columns]
    names = [str(name) for name in one.frame.columns]
    return {
        "title": one.title,
        "stem": one.stem,
        "note": one.note,
        "files": TABLE_FILES if one.stem else (),
        "columns": [name.replace("_", " ") for name in names],
        "rows": [
            [
                _cell(cell_text(value), badge=_badge(name, cell_text(value)), number=number)
                for name, value, number in zip(names, row, numeric, strict=True)
            ]
            for row in one.frame.itertuples(index=False)
        ],
    }


def _badge(name: str, text: str) -> str:
    """The look of a cell that says whether a number is comparable; empty for all other cells."""
    if name != BADGE_COLUMN:
        return ""
    return "yes" if text == YES else "none" if text == NOT_MEASURED else "no"
