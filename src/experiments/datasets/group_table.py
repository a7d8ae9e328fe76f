"""``groups.csv``: a row for each case with its group, and where known its pixel size and its role in the study."""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.datasets.csv_tables import read_table
from experiments.errors import InputError
from experiments.files import write_text

Spacing = tuple[float, float]
SPACING = ("vertical_mm", "horizontal_mm")
ROLES = ("cross-validation", "selection", "test")


@dataclass(frozen=True)
class GroupRow:
    """What ``groups.csv`` holds of one case.

    Parameters
    ----------
    group : str
        Subject, session or recording.
    spacing_mm : (float, float) or None
        Pixel size (vertical, horizontal); None: not known.
    role : str
        ``cross-validation``, ``selection``, ``test``, or empty.
    original : str
        The name that the case had elsewhere, or empty.
    """

    group: str
    spacing_mm: Spacing | None = None
    role: str = ""
    original: str = ""


def read_groups(path: Path, cases: Collection[str]) -> dict[str, GroupRow]:
    """Read the rows of cases, in the table's order.

    Parameters
    ----------
    path : Path
        A CSV file with columns ``case`` and ``group``; it may have ``vertical_mm`` and ``horizontal_mm``
        (both empty: not known), ``role`` and ``original``.
    cases : collection of str
        The cases that must be in the table; other rows are ignored.

    Returns
    -------
    dict of str to GroupRow
        Rows by case.

    Raises
    ------
    InputError
        If a case has no group or two rows, or a cell is not as expected; the message names the case.
    """
    rows: dict[str, dict[str, str]] = {}
    for row in read_table(path, ("case", "group")):
        if rows.setdefault(row["case"], row) is not row:
            raise InputError(f"{path}: expected one row for each case, received two for {row['case']!r}")
    for name in sorted(cases):
        if name not in rows or not rows[name]["group"]:
            raise InputError(f"{path}: expected a group for image {name!r}, found none")
    return {name: _row(row, f"{path}: {name}") for name, row in rows.items() if name in set(cases)}


def write_groups(path: Path, rows: dict[str, GroupRow]) -> None:
    """Write a table that ``read_groups`` reads.

    Parameters
    ----------
    path : Path
        The CSV file.
    rows : dict of str to GroupRow
        Rows by case. A column that no case has a value for is left out.
    """
    text = io.StringIO()
    columns = ["case", "group"]
    columns += SPACING if any(row.spacing_mm for row in rows.values()) else ()
    columns += [name for name in ("role", "original") if any(getattr(row, name) for row in rows.values())]
    writer = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for case, row in rows.items():
        sides = dict(zip(SPACING, row.spacing_mm or ("", ""), strict=True))
        writer.writerow(
            {"case": case, "group": row.group, "role": row.role, "original": row.original, **sides}
        )
    write_text(path, text.getvalue())


def groups_by_role(group_of: Mapping[str, str], role_of: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Return the groups of each role.

    Parameters
    ----------
    group_of : mapping of str to str
        Group of each case.
    role_of : mapping of str to str
        Role of each case; empty is cross-validation.

    Returns
    -------
    dict of str to tuple of str
        Sorted groups of each of the roles.

    Raises
    ------
    InputError
        If the cases of a group have two roles; the message names the group.
    """
    roles: dict[str, str] = {}
    for case, group in group_of.items():
        own = role_of[case] or ROLES[0]
        if roles.setdefault(group, own) != own:
            raise InputError(
                f"groups: expected one role for group {group!r}, found cases of it for {roles[group]} and for {own}"
            )
    return {role: tuple(sorted(g for g in roles if roles[g] == role)) for role in ROLES}


def spacing_pair(sides: Sequence[float | str], where: str) -> Spacing:
    """Convert two pixel sizes.

    Parameters
    ----------
    sides : sequence of float or str
        Vertical and horizontal size in mm.
    where : str
        Setting or file and row, for the message.

    Returns
    -------
    (float, float)
        Vertical and horizontal size in mm.

    Raises
    ------
    InputError
        If they are not two positive finite numbers.
    """
    try:
        vertical, horizontal = (float(side) for side in sides)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{where}: expected two pixel sizes in mm (vertical, horizontal), received {sides}"
        ) from error
    if not (0 < vertical < float("inf") and 0 < horizontal < float("inf")):
        raise InputError(f"{where}: expected positive pixel sizes in mm, received {vertical} x {horizontal}")
    return vertical, horizontal


def _row(row: dict[str, str], where: str) -> GroupRow:
    sides = tuple(row.get(side) or "" for side in SPACING)
    role = row.get("role") or ""
    if role and role not in ROLES:
        raise InputError(f"{where}: expected role {', '.join(ROLES)} or none, received {role!r}")
    return GroupRow(
        row["group"], spacing_pair(sides, where) if any(sides) else None, role, row.get("original") or ""
    )
