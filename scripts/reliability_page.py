"""results/reliability.md: faults first, which one command writes, then damaged files, which another adds to."""

from __future__ import annotations

from pathlib import Path

HEADING = "## Damaged files"
ABOUT = (
    "Files that the project's own writers made, changed at random; each reader works in a process that may die, under "
    "a limit of memory and time (`make fuzz`; `python scripts/fuzz_readers.py --reader NAME --out "
    "results/reliability.md` renews the rows of one). *Changed values*: one bit of what is packed was changed, and "
    "other numbers were read."
)
COUNTED = ("files", "accepted", "refused", "foreign", "crashed", "over 10 s", "over 1 GB", "changed values")
COLUMNS = (*COUNTED, "seed", "commit")


def faults_part(text: str) -> str:
    """What comes before the damaged files."""
    return text.partition(HEADING)[0]


def damaged_part(text: str) -> str:
    """The damaged files, from their heading on; nothing where there are none."""
    _, heading, rest = text.partition(HEADING)
    return heading + rest


def damaged_rows(text: str) -> dict[str, dict[str, str]]:
    """The rows of the damaged files by reader, as they stand there."""
    cells = [
        [cell.strip() for cell in line.strip("|\n ").split("|")]
        for line in damaged_part(text).splitlines()
        if line.startswith("| ")
    ]
    if not cells or tuple(cells[0][1:]) != COLUMNS:
        return {}
    return {
        row[0]: dict(zip(COLUMNS, row[1:], strict=True)) for row in cells[1:] if not row[0].startswith("**")
    }


def with_faults(text: str, faults: str) -> str:
    """The page with other faults; its damaged files stay."""
    damaged = damaged_part(text)
    return faults.rstrip("\n") + "\n" + ("\n" + damaged if damaged else "")


def with_damaged(text: str, rows: dict[str, dict[str, str]]) -> str:
    """The page with these readers' rows, in this order; those of other readers and the faults stay."""
    every = {**damaged_rows(text), **rows}
    total = {name: str(sum(int(row[name]) for row in every.values())) for name in COUNTED}
    lines = [HEADING, "", ABOUT, "", f"| reader | {' | '.join(COLUMNS)} |", "|---|" + "---:|" * len(COLUMNS)]
    lines += [_line(reader, row) for reader, row in every.items()]
    lines.append(_line("**all**", {name: f"**{count}**" for name, count in total.items()}))
    before = faults_part(text).rstrip("\n")
    return (before + "\n\n" if before else "") + "\n".join(lines) + "\n"


def page_of(path: Path) -> str:
    """The page as it stands; nothing where there is none."""
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _line(reader: str, row: dict[str, str]) -> str:
    return f"| {reader} | {' | '.join(row.get(name, '') for name in COLUMNS)} |"
