"""What the benchmarks share: the option --quick, and where the public data is that some of them need."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]


def parsed(
    parser: argparse.ArgumentParser, quick: Mapping[str, Any], arguments: Sequence[str] | None = None
) -> argparse.Namespace:
    """Read the command line; with --quick the defaults are those of ``quick``, and what is given still counts."""
    budget = ", ".join(f"{name.replace('_', '-')} {value}" for name, value in quick.items())
    parser.add_argument("--quick", action="store_true", help=f"a small budget, to see that it runs: {budget}")
    if parser.parse_args(arguments).quick:
        parser.set_defaults(**quick)
    return parser.parse_args(arguments)


def data_folder(given: Path | None, name: str) -> Path | None:
    """The folder that was given, else ``name`` of the public data; None, and a sentence, where that is missing."""
    if given is not None:
        return given
    root = Path(os.environ.get("CTUS_TEST_DATA") or REPOSITORY.parent / "shared" / "data")
    if (root / name).is_dir():
        return root / name
    print(f"Skipped: expected the public data in {root / name} (set CTUS_TEST_DATA), found none.")
    return None
