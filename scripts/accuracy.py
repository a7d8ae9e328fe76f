"""Write results/accuracy.md and its figures from what study=accuracy measured.

Usage: python scripts/accuracy.py FOLDER [SETTINGS], where FOLDER is what `ctus -m +sweep=figure_accuracy out=FOLDER`
left, and SETTINGS what `ctus -m +sweep=accuracy_settings out=SETTINGS` left.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from experiments.analysis.pages import accuracy as page
from experiments.errors import InputError
from experiments.studies.accuracy.report import shown

SETTINGS = ("beta_mm", "roughness_per_mm2")


def main() -> int:
    """Write the page; 2 if there is nothing to write it from."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, help="what the study wrote")
    parser.add_argument("settings", type=Path, nargs="?", help="what it wrote with two settings varied")
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder of the page")
    given = parser.parse_args()
    try:
        rows = page.write_page(
            given.folder, given.settings, given.results, shown, partial(shown, parameters=SETTINGS)
        )
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    print(f"{rows} rows: {given.results / 'accuracy.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
