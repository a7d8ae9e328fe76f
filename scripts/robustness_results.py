"""Write results/<NAME>.md with its tables (CSV) and figures (PNG) from what study=robustness measured.

Usage: python scripts/robustness_results.py FOLDER [NAME] [RESULTS], where FOLDER is what
`ctus -m +sweep=<preset> target=<surface> out=FOLDER` left; NAME is robustness, RESULTS is results by default.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from experiments.analysis.pages import robustness as page
from experiments.errors import InputError
from experiments.studies.robustness import study


def main() -> int:
    """Write the page; 2 if there is nothing to write it from."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, help="what the study wrote")
    parser.add_argument("name", nargs="?", default="robustness", help="of the page")
    parser.add_argument("results", nargs="?", type=Path, default=Path("results"), help="folder of the page")
    given = parser.parse_args()
    try:
        trials = page.write_page(given.folder, given.results, given.name, study.shown)
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    print(f"{trials} trials: {given.results / given.name}.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
