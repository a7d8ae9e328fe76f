"""Write results/consolidation_<data set>.md from the runs under results/runs: no training is repeated for it.

Usage: python scripts/consolidation_results.py DATASET [ARCHIVE] [OUT], where DATASET is usgra, carotid or simulated.
The runs come from ctus -m +sweep=consolidation_<DATASET>, followed by ctus study=export_runs
"experiments=[consolidation]".
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from experiments.analysis.pages import consolidation as page
from experiments.errors import InputError
from experiments.studies import consolidation


def main() -> int:
    """Write the page; 2 if there is nothing to write it from."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("dataset", help="name of the data set; simulated: all simulated ones")
    parser.add_argument(
        "archive", nargs="?", type=Path, default=Path("results/runs"), help="of exported runs"
    )
    parser.add_argument("out", nargs="?", type=Path, default=Path("results"), help="folder of the page")
    given = parser.parse_args()
    try:
        page.write_page(given.archive, given.out, given.dataset, consolidation.summarise)
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    print(given.out / f"consolidation_{given.dataset}.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
