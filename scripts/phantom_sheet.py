"""Write a contact sheet of simulated frames, and one next to real frames when given a folder of them.

    python scripts/phantom_sheet.py --out sheet.png [--outline] [--real FOLDER]

FOLDER holds images/*.png and masks/*.png (2 is the vessel where there is more than one label). A sheet with real frames
is for looking at only: those images belong to others.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from experiments.reporting.contact_sheet import contact_sheet, outlined
from experiments.reporting.phantom_realism import dark_dsc, grain_px, vessel_gcnr
from registration.phantom.acoustics import Scanner
from registration.phantom.settings import SUBSETS, PhantomSettings
from registration.phantom.simulator import SweepSimulator

COLUMNS = 4
SIZE_PX = 512
Case = tuple[np.ndarray, np.ndarray]


def simulated(subset: str) -> list[Case]:
    """Frames of two sweeps of one phantom with their masks."""
    settings = PhantomSettings(subset=subset, scanner=Scanner(height_px=SIZE_PX, width_px=SIZE_PX))
    cases = []
    for column in range(COLUMNS):
        maker = SweepSimulator(settings, column % 2)
        picture, mask, _ = maker.frame(8 + 14 * column, maker.view(8 + 14 * column))
        cases.append((picture, mask))
    return cases


def real(folder: Path) -> list[Case]:
    """Frames spread over a folder, with their vessels."""
    names = sorted((folder / "images").glob("*.png"))
    cases = []
    for path in names[:: max(1, len(names) // (3 * COLUMNS))][: 3 * COLUMNS]:
        labels = np.asarray(Image.open(folder / "masks" / path.name))
        labels = labels[..., 0] if labels.ndim == 3 else labels
        cases.append((np.asarray(Image.open(path).convert("L")), labels == (2 if labels.max() == 2 else 255)))
    return cases


def describe(name: str, cases: list[Case]) -> str:
    """One line of numbers for a set of frames."""
    contrast = [value for picture, mask in cases for value in vessel_gcnr(picture, mask)]
    grain = np.nanmedian([grain_px(picture, picture > 0) for picture, _ in cases], axis=0)
    otsu = np.nanmedian([dark_dsc(picture, mask) for picture, mask in cases if mask.any()])
    return (
        f"{name:11s} gCNR {np.median(contrast):.2f}   grain {grain[0]:.1f} x {grain[1]:.1f} px   "
        f"mean grey {np.mean([picture.mean() for picture, _ in cases]):.0f}   DSC of Otsu's threshold {otsu:.2f}"
    )


def main() -> None:
    """Make the sheet and print how the frames compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--outline", action="store_true", help="draw the masks' borders")
    parser.add_argument("--real", type=Path, help="folder of real frames to show next to them")
    parser.add_argument("--tile-px", type=int, default=320)
    options = parser.parse_args()
    sets = {subset: simulated(subset) for subset in SUBSETS}
    if options.real is not None:
        sets["real"] = real(options.real)
    rows = []
    for name, cases in sets.items():
        print(describe(name, cases))
        pictures = [outlined(*case) if options.outline else case[0] for case in cases]
        rows += [pictures[start : start + COLUMNS] for start in range(0, len(pictures), COLUMNS)]
    Image.fromarray(contact_sheet(rows, options.tile_px)).save(options.out)
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
