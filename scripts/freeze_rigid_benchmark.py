"""Write the digests of the rigid benchmark's cases as they are now to conf/benchmark/rigid.json.

Usage: python scripts/freeze_rigid_benchmark.py FOLDER, which holds all cases, as study=rigid_benchmark root=FOLDER
makes them. Whatever was measured before is not comparable with what is measured after.
"""

from __future__ import annotations

import sys
from pathlib import Path

from experiments.analysis.registration.benchmark.cases import freeze, frozen_file
from registration.benchmark.blocks import SUBSETS, blocks_of, collection_name

if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    blocks = [(subset, block) for subset in SUBSETS for block in blocks_of(subset)]
    count = freeze({one: Path(sys.argv[1]) / collection_name(*one) for one in blocks})
    print(f"{count} cases: {frozen_file()}")
