"""Anyone's images and masks in two folders, with a table of what belongs together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import numpy as np

from experiments.datasets import reading
from experiments.datasets.dicom import SUFFIX as DICOM_SUFFIX
from experiments.datasets.dicom import read_dicom
from experiments.datasets.group_table import Spacing, groups_by_role, read_groups, spacing_pair
from experiments.errors import InputError
from experiments.paths import PathSetting
from models.labelled_frames import LabelledFrames


@dataclass(frozen=True)
class Folder:
    """``root/images`` and ``root/masks`` with files of the same names, and ``root/groups.csv``.

    The table has a row for each image with columns ``case`` (the name without suffix) and ``group`` (subject, session
    or recording), and may have ``vertical_mm`` and ``horizontal_mm``, the pixel's size, and ``role`` (see
    ``read_groups``). Where it has no size, that is the one that a DICOM file gives, else ``spacing_mm`` (vertical,
    horizontal). Masks hold ``vessel_labels`` and
    ``other_labels`` only. A DICOM film ``clip.dcm`` has one row, ``clip``, and thus one group; the masks of its frames
    are ``clip_0000``, ``clip_0001`` and so on, and frames without one are no cases.
    """

    root: PathSetting
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
            object.__setattr__(self, "spacing_mm", spacing_pair(self.spacing_mm, "spacing_mm"))

    def require_root(self) -> Path:
        """The folder; InputError says what it must hold if it is not there."""
        return reading.require_root(
            self.name, self.root, "images of your own", "images/, masks/ of the same names, groups.csv"
        )

    def __call__(self) -> LabelledFrames:
        """Read the images and masks; InputError names the folder or file that is not as expected."""
        return _read(self)[0]

    def test_groups(self) -> tuple[str, ...]:
        """The groups whose role is test."""
        return _read(self)[1]["test"]

    def selection_groups(self) -> tuple[str, ...]:
        """The groups whose role is selection."""
        return _read(self)[1]["selection"]


@dataclass(frozen=True)
class _Picture:
    """One frame, the name of the file it is from, and the pixel size that the file gives."""

    image: np.ndarray
    file: str
    spacing_mm: Spacing | None


@lru_cache(maxsize=1)
def _read(dataset: Folder) -> tuple[LabelledFrames, dict[str, tuple[str, ...]]]:
    """The frames, and the groups of each role."""
    root = dataset.require_root()
    files, mask_files = reading.image_files(root / "images"), reading.image_files(root / "masks")
    # What can be refused by names alone is refused before any pixel is read.
    reading.paired(
        {name: path for name, path in files.items() if not _is_dicom(path)},
        {name: path for name, path in mask_files.items() if not _may_be_of_dicom(name, files)},
    )
    rows = read_groups(root / "groups.csv", files)
    pictures = _pictures(files, mask_files)
    masks = tuple(
        reading.read_mask(mask_files[case], dataset.vessel_labels, dataset.other_labels, picture.image.shape)
        for case, picture in pictures.items()
    )
    reading.require_vessel(root / "masks", masks)
    frames = LabelledFrames(
        images=tuple(picture.image for picture in pictures.values()),
        masks=masks,
        case_ids=tuple(pictures),
        groups=tuple(rows[picture.file].group for picture in pictures.values()),
        spacing_mm=tuple(
            rows[picture.file].spacing_mm or picture.spacing_mm or dataset.spacing_mm  # type: ignore[misc]
            for picture in pictures.values()
        ),
        simulated=False,
    )
    roles = groups_by_role(
        {file: row.group for file, row in rows.items()}, {file: row.role for file, row in rows.items()}
    )
    return frames, roles


def _is_dicom(path: Path) -> bool:
    return path.suffix.lower() == DICOM_SUFFIX


def _may_be_of_dicom(mask: str, files: Mapping[str, Path]) -> bool:
    return any(name in files and _is_dicom(files[name]) for name in (mask, mask.rpartition("_")[0]))


def _pictures(files: Mapping[str, Path], masks: Mapping[str, Path]) -> dict[str, _Picture]:
    """The frames that have a mask, by case; InputError for a mask without its frame, or a file without any mask."""
    pictures: dict[str, _Picture] = {}
    for name, path in files.items():
        if not _is_dicom(path):
            pictures[name] = _Picture(reading.read_grey(path), name, None)
            continue
        film = read_dicom(path)
        cases = (
            [name] if len(film.images) == 1 else [f"{name}_{index:04d}" for index in range(len(film.images))]
        )
        found = {
            case: _Picture(np.ascontiguousarray(image), name, film.spacing_mm)
            for case, image in zip(cases, film.images, strict=True)
            if case in masks
        }
        if not found:
            raise InputError(f"{path}: expected a mask named {cases[0]}, found none for any of its frames")
        pictures |= found
    reading.paired(dict.fromkeys(pictures, Path()), masks)
    return pictures
