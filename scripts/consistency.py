"""Write results/consistency.md and results/consistency.png from what study=consistency measured.

Usage: python scripts/consistency.py FOLDER [RESULTS], where FOLDER is what `ctus study=consistency out=FOLDER` left.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from experiments.analysis.pages import consistency as page
from experiments.errors import InputError
from experiments.studies.consistency import study
from experiments.studies.consistency.report import TRUTH


def main() -> int:
    """Write the page; 2 if there is nothing to write it from."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, help="what the study wrote")
    parser.add_argument("results", nargs="?", type=Path, default=Path("results"), help="folder of the page")
    given = parser.parse_args()
    try:
        sweeps = page.write_page(given.folder, given.results, study.shown, TRUTH)
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    print(f"{sweeps} sweeps: {given.results / 'consistency.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
