"""Write results/segmentation_<data set>.md from the runs under results/runs: no training is repeated for it.

Usage: python scripts/segmentation_results.py DATASET [ARCHIVE] [OUT], where DATASET is usgra or carotid. The runs come
from the commands that the page names, followed by ctus study=export_runs "experiments=[segmentation,domain_transfer]".
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from experiments.analysis.pages import segmentation as page
from experiments.errors import InputError
from experiments.studies import segmentation
from experiments.studies.domain_transfer import study as domain_transfer

SUMMARISE = {"segmentation": segmentation.summarise, "domain_transfer": domain_transfer.summarise}


def main() -> int:
    """Write the page; 2 if there is nothing to write it from."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("dataset", help="name of the data set")
    parser.add_argument("archive", nargs="?", type=Path, default=Path("results/runs"), help="exported runs")
    parser.add_argument("out", nargs="?", type=Path, default=Path("results"), help="folder of the page")
    given = parser.parse_args()
    path = given.out / f"segmentation_{given.dataset}.md"
    try:
        page.write_page(given.archive, path, given.dataset, SUMMARISE)
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
