"""Tables of what a data set left out and why, beside the results of the study that used it."""

from __future__ import annotations

from pathlib import Path

from experiments.files import write_text


def write_report(dataset: object, folder: Path) -> tuple[Path, ...]:
    """Write ``<name>.csv`` into ``folder`` for each table of the data set; nothing where it has none to give."""
    report = getattr(dataset, "report", None)
    if report is None:
        return ()
    written = []
    for name, table in report().items():
        path = folder / f"{name}.csv"
        write_text(path, table.to_csv(index=False))
        written.append(path)
    return tuple(written)
