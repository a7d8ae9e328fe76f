"""Write results/rigid_benchmark.md, .csv and .png from what study=rigid_benchmark measured.

Usage: python scripts/rigid_benchmark.py FOLDER [RESULTS], where FOLDER holds a folder `test`, and may hold
`symmetric` and `blocks`, as `ctus study=rigid_benchmark subset=test out=FOLDER/test` and its like left them.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from experiments.analysis.pages import rigid_benchmark as page
from experiments.errors import InputError


def main() -> int:
    """Write the page; 2 if there is nothing to write it from."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, help="what the study wrote")
    parser.add_argument("results", nargs="?", type=Path, default=Path("results"), help="folder of the page")
    given = parser.parse_args()
    try:
        count = page.write_page(given.folder, given.results)
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    print(f"{count} results: {given.results / 'rigid_benchmark.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
