"""A data set in nnU-Net's raw layout, of 2-D natural images.

Format: nnU-Net v2, documentation/dataset_format.md.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

from experiments.datasets import reading
from experiments.datasets.group_table import GroupRow, groups_by_role, read_groups, spacing_pair
from experiments.datasets.pixel_cache import read_pairs
from experiments.errors import InputError
from experiments.paths import PathSetting
from models.labelled_frames import LabelledFrames

FILE_ENDINGS = (".png", ".bmp", ".tif")
CHANNEL = "_0000"
FOLDERS = {"Tr": "cross-validation", "Ts": "test", "Selection": "selection"}


@dataclass(frozen=True)
class NnUNet:
    """``root/imagesTr/<case>_0000.png`` with ``root/labelsTr/<case>.png`` and ``root/dataset.json``.

    ``target`` is the label of ``dataset.json`` that is segmented. ``imagesTs`` counts where ``labelsTs`` is beside it:
    its groups are kept for the test. ``imagesSelection`` with ``labelsSelection``, which nnU-Net doesn't look at, are
    groups kept for selection. ``groups`` is a table as ``read_groups`` takes it; null: ``root/groups.csv`` where that
    is, else each case is a group of its own. nnU-Net takes PNG for 1 mm a pixel; here the pixel size is that of the
    table, else ``spacing_mm`` (vertical, horizontal), else not known. Images have one channel of 8 bits; RGB becomes
    grey. What is read is kept in ``cache`` (None: nowhere).
    """

    root: PathSetting
    target: str = "vessel"
    spacing_mm: Sequence[float] | None = None
    groups: PathSetting | None = None
    cache: str | None = None

    name: ClassVar[str] = "nnunet"

    def __post_init__(self) -> None:
        if self.spacing_mm is not None:
            object.__setattr__(self, "spacing_mm", spacing_pair(self.spacing_mm, "spacing_mm"))

    def require_root(self) -> Path:
        """The folder; InputError says what it must hold if it is not there."""
        return reading.require_root(
            self.name,
            self.root,
            "a DatasetXXX_Name folder of nnU-Net's raw data",
            "imagesTr/<case>_0000.png, labelsTr/<case>.png, dataset.json",
        )

    def __call__(self) -> LabelledFrames:
        """Read the images and masks; InputError names the folder or file that is not as expected."""
        return _read(self)[0]

    def test_groups(self) -> tuple[str, ...]:
        """The groups of ``imagesTs``."""
        return _read(self)[1]["test"]

    def selection_groups(self) -> tuple[str, ...]:
        """The groups of ``imagesSelection``."""
        return _read(self)[1]["selection"]

    def notes(self) -> tuple[str, ...]:
        """What of the folder is not known or not used."""
        root, notes = self.require_root(), []
        if self._table is None:
            notes.append("No groups.csv: each case is a group of its own, subject leakage can't be excluded.")
        if (root / "imagesTs").is_dir() and not (root / "labelsTs").is_dir():
            notes.append("imagesTs has no labelsTs beside it and is not used.")
        return tuple(notes)

    @property
    def _table(self) -> Path | None:
        if self.groups is not None:
            return Path(self.groups).expanduser()
        table = self.require_root() / "groups.csv"
        return table if table.is_file() else None


@lru_cache(maxsize=1)
def _read(dataset: NnUNet) -> tuple[LabelledFrames, dict[str, tuple[str, ...]]]:
    """The frames, and the groups of each role."""
    root = dataset.require_root()
    labels, others, ending = _described(root / "dataset.json", dataset.target)
    files, role_of = _files(root, ending)
    table = dataset._table
    rows = {case: GroupRow(case) for case in files} if table is None else read_groups(table, set(files))
    image_files, mask_files = zip(*(files[case] for case in rows), strict=True)
    images, masks = read_pairs(image_files, mask_files, sorted(labels), sorted(others), dataset.cache)
    reading.require_vessel(root / "labelsTr", masks)
    frames = LabelledFrames(
        images=images,
        masks=masks,
        case_ids=tuple(rows),
        groups=tuple(row.group for row in rows.values()),
        spacing_mm=tuple(row.spacing_mm or dataset.spacing_mm for row in rows.values()),  # type: ignore[misc]
        simulated=False,
    )
    return frames, groups_by_role({case: row.group for case, row in rows.items()}, role_of)


def _described(path: Path, target: str) -> tuple[set[int], set[int], str]:
    """Labels of the target, all other labels, and the files' ending."""
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8-sig"))
        labels = {str(name): _numbers(value) for name, value in content["labels"].items()}
        ending, channels = str(content["file_ending"]), len(content["channel_names"])
    except (OSError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path}: expected JSON with channel_names, labels and file_ending, received another file ({error})"
        ) from error
    if ending not in FILE_ENDINGS:
        raise InputError(f"{path}: expected a file_ending of {', '.join(FILE_ENDINGS)}, received {ending!r}")
    if channels not in (1, 3):
        raise InputError(f"{path}: expected one channel, or three of an RGB image, received {channels}")
    foreground = [name for name in labels if name != "background"]
    if target not in foreground:
        raise InputError(f"target: expected a label of {path} ({', '.join(foreground)}), received {target!r}")
    known = {0}.union(*labels.values())
    return labels[target], known - labels[target], ending


def _numbers(value: Any) -> set[int]:
    # A region is a list of labels (nnU-Net's region-based training).
    return {int(label) for label in value} if isinstance(value, list) else {int(value)}


def _files(root: Path, ending: str) -> tuple[dict[str, tuple[Path, Path]], dict[str, str]]:
    """Image and label file of each case, sorted by case, and the role of the folder they are in."""
    files: dict[str, tuple[Path, Path]] = {}
    role_of: dict[str, str] = {}
    for part, role in FOLDERS.items():
        images, labels = root / f"images{part}", root / f"labels{part}"
        if part != "Tr" and not (images.is_dir() and labels.is_dir()):
            continue
        named = {_case(path, ending): path for path in reading.image_files(images).values()}
        masks = reading.image_files(labels)
        reading.paired(named, masks)
        for case, path in named.items():
            if case in files:
                raise InputError(f"{path}: expected a case of another name than {files[case][0]}")
            files[case], role_of[case] = (path, masks[case]), role
    return dict(sorted(files.items())), role_of


def _case(path: Path, ending: str) -> str:
    if path.suffix != ending or not path.stem.endswith(CHANNEL):
        raise InputError(f"{path}: expected one image a case, <case>{CHANNEL}{ending}, received another name")
    return path.stem.removesuffix(CHANNEL)
