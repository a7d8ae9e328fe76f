"""Write results/plus_values.md: values that the PLUS toolkit published for its test data, next to ours.

Usage: python scripts/plus_values.py FOLDER [OUT], where FOLDER holds the toolkit's files (such as
SpinePhantomFreehand.igs.mha), by default $CTUS_TEST_DATA/plus.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from experiments import files
from experiments.running.terminal import markdown
from experiments.validation.plus import ALL, table

HEAD = """# Values of the PLUS toolkit and ours

Computed by `python scripts/plus_values.py` from the test data of the PLUS toolkit (BSD licence, plustoolkit.github.io).
The largest jumps are between poses interpolated to five times the recorded rate, as in the toolkit's own test.
A reconstruction with holes filled (SpinePhantomFreehandReconstructed) has voxels that no pixel fell on; for one that
was cut to a fan (vtkVolumeReconstructorTestNNLATEvolumeRef) only the voxels that PLUS filled are compared.

"""


def main() -> int:
    """Compute every value and write the table; 1 if a published value is not met."""
    given = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("CTUS_TEST_DATA", "") + "/plus"
    folder, out = Path(given), Path(sys.argv[2] if len(sys.argv) > 2 else "results/plus_values.md")
    if not (folder / "SpinePhantomFreehand.igs.mha").is_file():
        print(f"{folder}: expected the test data of the PLUS toolkit, found none", file=sys.stderr)
        return 2
    values = [value for part in ALL for value in part(folder)]
    files.write_text(out, HEAD + markdown({"Values": table(values)}).strip() + "\n")
    missed = [value for value in values if value.met is False]
    print(f"{len(values)} values, {len(missed)} not met: {out}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
