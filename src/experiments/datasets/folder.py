"""Anyone's images and masks in two folders, with a table of what belongs together."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

from experiments.datasets import reading
from experiments.errors import InputError
from models.labelled_frames import LabelledFrames

Spacing = tuple[float, float]


@dataclass(frozen=True)
class Folder:
    """``root/images`` and ``root/masks`` with files of the same names, and ``root/groups.csv``.

    The table has a row for each image with columns ``case`` (the name without suffix) and ``group`` (subject, session
    or recording), and may have ``vertical_mm`` and ``horizontal_mm``, the pixel's size. ``spacing_mm`` (vertical,
    horizontal) is for all images where the table has none. Masks hold ``vessel_labels`` and ``other_labels`` only.
    """

    root: str
    vessel_labels: Sequence[int] = (1, 255)
    other_labels: Sequence[int] = (0,)
    spacing_mm: Sequence[float] | None = None

    name: ClassVar[str] = "folder"

    def __post_init__(self) -> None:
        # Lists come from configurations; tuples make the data set a key under which its images are kept.
        for field in ("vessel_labels", "other_labels"):
            object.__setattr__(self, field, tuple(getattr(self, field)))
        if not self.vessel_labels or set(self.vessel_labels) & set(self.other_labels):
            raise InputError(
                f"vessel_labels: expected labels that are not among other_labels {self.other_labels}, "
                f"received {self.vessel_labels}"
            )
        if self.spacing_mm is not None:
            object.__setattr__(self, "spacing_mm", _spacing(self.spacing_mm, "spacing_mm"))

    def require_root(self) -> Path:
        """The folder; InputError says what it must hold if it is not there."""
        return reading.require_root(
            self.name, self.root, "images of your own", "images/, masks/ of the same names, groups.csv"
        )

    def __call__(self) -> LabelledFrames:
        """Read the images and masks; InputError names the folder or file that is not as expected."""
        return _read(self)


@lru_cache(maxsize=1)
def _read(dataset: Folder) -> LabelledFrames:
    root = dataset.require_root()
    files, mask_files = reading.image_files(root / "images"), reading.image_files(root / "masks")
    reading.paired(files, mask_files)
    rows = _read_table(root / "groups.csv", set(files))
    images = tuple(reading.read_grey(path) for path in files.values())
    masks = tuple(
        reading.read_mask(mask_files[name], dataset.vessel_labels, dataset.other_labels, image.shape)
        for name, image in zip(files, images, strict=True)
    )
    reading.require_vessel(root / "masks", masks)
    return LabelledFrames(
        images=images,
        masks=masks,
        case_ids=tuple(files),
        groups=tuple(rows[name][0] for name in files),
        spacing_mm=tuple(rows[name][1] or dataset.spacing_mm for name in files),  # type: ignore[misc]
        simulated=False,
    )


def _read_table(path: Path, cases: set[str]) -> dict[str, tuple[str, Spacing | None]]:
    """Group and spacing of each case."""
    if not path.is_file():
        raise InputError(f"{path}: expected a table with columns case and group, found no file")
    with path.open(newline="", encoding="utf-8-sig") as file:
        table = csv.DictReader(file)
        columns = set(table.fieldnames or ())
        if not {"case", "group"} <= columns:
            raise InputError(
                f"{path}: expected columns case and group, received {', '.join(sorted(columns)) or 'none'}"
            )
        rows = {row["case"]: row for row in table}
    for name in sorted(cases):
        if name not in rows or not rows[name]["group"]:
            raise InputError(f"{path}: expected a group for image {name!r}, found none")
    if {"vertical_mm", "horizontal_mm"} <= columns:
        return {
            name: (
                rows[name]["group"],
                _spacing((rows[name]["vertical_mm"], rows[name]["horizontal_mm"]), f"{path}: {name}"),
            )
            for name in cases
        }
    return {name: (rows[name]["group"], None) for name in cases}


def _spacing(sides: Sequence[float | str], where: str) -> Spacing:
    try:
        vertical, horizontal = (float(side) for side in sides)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{where}: expected two pixel sizes in mm (vertical, horizontal), received {sides}"
        ) from error
    if not (0 < vertical < float("inf") and 0 < horizontal < float("inf")):
        raise InputError(f"{where}: expected positive pixel sizes in mm, received {vertical} x {horizontal}")
    return vertical, horizontal
