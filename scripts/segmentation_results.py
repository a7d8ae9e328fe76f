"""Write results/segmentation_usgra.md from the runs under results/runs: no training is repeated for it.

Usage: python scripts/segmentation_results.py [ARCHIVE] [OUT]. The runs come from the commands that the page names,
followed by ctus study=export_runs "experiments=[segmentation,domain_transfer]".
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from experiments.analysis.pages import segmentation as page
from experiments.errors import InputError
from experiments.studies import segmentation
from experiments.studies.domain_transfer import study as domain_transfer

OUT = Path("results/segmentation_usgra.md")
SUMMARISE = {"segmentation": segmentation.summarise, "domain_transfer": domain_transfer.summarise}


def main() -> int:
    """Write the page; 2 if there is nothing to write it from."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument(
        "archive", nargs="?", type=Path, default=Path("results/runs"), help="of exported runs"
    )
    parser.add_argument("out", nargs="?", type=Path, default=OUT, help="file of the page")
    given = parser.parse_args()
    try:
        page.write_page(given.archive, given.out, SUMMARISE)
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    print(given.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
