"""A data set in nnU-Net's raw layout, of 2-D natural images.

Format: nnU-Net v2, documentation/dataset_format.md.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from experiments.datasets.content_key import cached_while_unchanged
from experiments.datasets.group_table import GroupRow, groups_by_role, read_groups, spacing_pair
from experiments.datasets.images import image_files as reading
from experiments.datasets.pairing import REFUSE, SKIP, Pairing, pair, require_choice
from experiments.datasets.pixel_cache import read_masks, read_pairs
from experiments.errors import InputError
from experiments.errors import reading as reading_file
from experiments.paths import PathSetting
from experiments.unicode_names import same_name
from models.labelled_frames import LabelledFrames
from registration.text_files import read_text

FILE_ENDINGS = (".png", ".bmp", ".tif")
CHANNEL = "_0000"
BACKGROUND, IGNORE = "background", "ignore"
FOLDERS = {"Tr": "cross-validation", "Ts": "test", "Selection": "selection"}


@dataclass(frozen=True)
class NnUNet:
    """``root/imagesTr/<case>_0000.png`` with ``root/labelsTr/<case>.png`` and ``root/dataset.json``.

    Parameters
    ----------
    root : Path
        A ``DatasetXXX_Name`` folder.
    target : str
        The label of ``dataset.json`` that is segmented.
    spacing_mm : sequence of float or None
        Pixel size (vertical, horizontal) of cases for which the table has none; None: not known. nnU-Net
        takes PNG for 1 mm a pixel.
    groups : Path or None
        A table as ``read_groups`` takes it; None: ``root/groups.csv`` where there is one, else each case is a
        group of its own.
    cache : str or None
        Folder for decoded pixels; None: they are not stored.
    unpaired : {'refuse', 'skip'}
        Whether images without a mask and masks without an image are refused or left out.
    ignored : {'refuse', 'skip', 'background'}
        What to do with images that have pixels of the label ``ignore``, which are not labelled: refuse them,
        leave them out, or take these pixels for background.

    Raises
    ------
    InputError
        If a setting has another value than those above.

    Notes
    -----
    Images have one channel of 8 bits; RGB becomes grey. ``imagesTs`` counts where there is a ``labelsTs``:
    its groups are kept for the test. ``imagesSelection`` with ``labelsSelection``, which nnU-Net ignores, are
    groups kept for selection.
    """

    root: PathSetting
    target: str = "vessel"
    spacing_mm: Sequence[float] | None = None
    groups: PathSetting | None = None
    cache: str | None = None
    unpaired: str = REFUSE
    ignored: str = REFUSE

    name: ClassVar[str] = "nnunet"

    def __post_init__(self) -> None:
        require_choice(self.unpaired)
        if self.ignored not in (REFUSE, SKIP, BACKGROUND):
            raise InputError(f"ignored: expected {REFUSE}, {SKIP} or {BACKGROUND}, received {self.ignored!r}")
        if self.spacing_mm is not None:
            object.__setattr__(self, "spacing_mm", spacing_pair(self.spacing_mm, "spacing_mm"))

    def require_root(self) -> Path:
        """Check that the folder is there.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        InputError
            If there is none; the message says what it must hold.
        """
        return reading.require_root(
            self.name,
            self.root,
            "a DatasetXXX_Name folder of nnU-Net's raw data",
            "imagesTr/<case>_0000.png, labelsTr/<case>.png, dataset.json",
        )

    def __call__(self) -> LabelledFrames:
        """Read the images and masks.

        Returns
        -------
        LabelledFrames
            All frames that are used.

        Raises
        ------
        InputError
            If a file or folder is not as expected; the message names it.
        """
        return _read(self).frames

    def test_groups(self) -> tuple[str, ...]:
        """Return the groups of ``imagesTs``.

        Returns
        -------
        tuple of str
            Group names, sorted.
        """
        return _read(self).roles["test"]

    def selection_groups(self) -> tuple[str, ...]:
        """Return the groups of ``imagesSelection``.

        Returns
        -------
        tuple of str
            Group names, sorted.
        """
        return _read(self).roles["selection"]

    def notes(self) -> tuple[str, ...]:
        """Return what of the folder is not known or not used.

        Returns
        -------
        tuple of str
            Sentences.
        """
        root, notes = self.require_root(), []
        if self._table is None:
            notes.append("No groups.csv: each case is a group of its own, subject leakage can't be excluded.")
        if (root / "imagesTs").is_dir() and not (root / "labelsTs").is_dir():
            notes.append("imagesTs is not used: there is no labelsTs.")
        return (*notes, *_left_out_notes(self))

    def left_out(self) -> int:
        """Count the images and masks that were left out because they had no partner.

        Returns
        -------
        int
            Number of files.
        """
        return _paired(self.require_root(), self)[0].unpaired

    @property
    def _table(self) -> Path | None:
        if self.groups is not None:
            return Path(self.groups).expanduser()
        table = self.require_root() / "groups.csv"
        return table if table.is_file() else None


@dataclass(frozen=True)
class _Content:
    """The frames, the groups of each role, and how many images have pixels of the label ``ignore``."""

    frames: LabelledFrames
    roles: dict[str, tuple[str, ...]]
    with_ignored: int


@dataclass(frozen=True)
class _Labels:
    """The numbers of the target, of all else that is labelled, and of what is not labelled; and the files' ending."""

    target: set[int]
    others: set[int]
    ignored: set[int]
    ending: str


def _files(dataset: NnUNet) -> tuple[Path, ...]:
    root, table = dataset.require_root(), dataset._table
    files = _paired(root, dataset)[0].files
    return (*files, root / "dataset.json", *(() if table is None else (table,)))


@cached_while_unchanged(_files)
def _read(dataset: NnUNet) -> _Content:
    root = dataset.require_root()
    pairing, role_of = _paired(root, dataset)
    files = pairing.pairs
    labels = _described(root / "dataset.json", dataset.target)
    table = dataset._table
    rows = {case: GroupRow(case) for case in files} if table is None else read_groups(table, set(files))
    image_files, mask_files = zip(*(files[case] for case in rows), strict=True)
    background = labels.others | labels.ignored
    images, masks = read_pairs(
        image_files, mask_files, sorted(labels.target), sorted(background), dataset.cache
    )
    reading.require_vessel(root / "labelsTr", masks)
    frames = LabelledFrames(
        images=images,
        masks=masks,
        case_ids=tuple(rows),
        groups=tuple(row.group for row in rows.values()),
        spacing_mm=tuple(row.spacing_mm or dataset.spacing_mm for row in rows.values()),  # type: ignore[misc]
        simulated=False,
    )
    found = _ignored(dataset, labels, frames, mask_files)
    if dataset.ignored == SKIP and found:
        frames = frames.subset(index for index, case in enumerate(rows) if case not in found)
    groups = dict(zip(frames.case_ids, frames.groups, strict=True))
    return _Content(frames, groups_by_role(groups, role_of), len(found))


def _ignored(
    dataset: NnUNet, labels: _Labels, frames: LabelledFrames, mask_files: Sequence[Path]
) -> set[str]:
    """Return the cases with pixels that are not labelled; InputError where they are refused."""
    if not labels.ignored:
        return set()
    sizes = [image.shape for image in frames.images]
    known = sorted(labels.target | labels.others)
    shown = read_masks(mask_files, sizes, sorted(labels.ignored), known, dataset.cache)
    cases = [case for case, mask in zip(frames.case_ids, shown, strict=True) if mask.any()]
    if cases and dataset.ignored == REFUSE:
        first = mask_files[frames.case_ids.index(cases[0])]
        raise InputError(
            f"{first}: expected every pixel labelled, received pixels of the label {IGNORE} in {len(cases)} of "
            f"{len(frames)} images; pass dataset.ignored={SKIP} to leave these images out, or "
            f"dataset.ignored={BACKGROUND} to take such pixels for background"
        )
    if dataset.ignored == SKIP and len(cases) == len(frames):
        raise InputError(
            f"ignored: expected images without the label {IGNORE} where they alone are taken, found none"
        )
    return set(cases)


def _left_out_notes(dataset: NnUNet) -> tuple[str, ...]:
    root = dataset.require_root()
    notes = _paired(root, dataset)[0].notes(root)
    count = _read(dataset).with_ignored if (root / "dataset.json").is_file() else 0
    if not count:
        return notes
    how = "are left out" if dataset.ignored == SKIP else "count as background there"
    return (*notes, f"{count} images have pixels that are not labelled ({IGNORE}); they {how}.")


def _described(path: Path, target: str) -> _Labels:
    with reading_file(path, "JSON with channel_names, labels and file_ending"):
        content: dict[str, Any] = json.loads(read_text(path))
        labels = {str(name): _numbers(value) for name, value in content["labels"].items()}
        ending, channels = str(content["file_ending"]), len(content["channel_names"])
    if ending not in FILE_ENDINGS:
        raise InputError(f"{path}: expected a file_ending of {', '.join(FILE_ENDINGS)}, received {ending!r}")
    if channels not in (1, 3):
        raise InputError(f"{path}: expected one channel, or three of an RGB image, received {channels}")
    foreground = [name for name in labels if name not in (BACKGROUND, IGNORE)]
    if target not in foreground:
        raise InputError(f"target: expected a label of {path} ({', '.join(foreground)}), received {target!r}")
    ignored = labels.pop(IGNORE, set())
    known = {0}.union(*labels.values())
    return _Labels(labels[target], known - labels[target], ignored, ending)


def _numbers(value: Any) -> set[int]:
    # A region is a list of labels (nnU-Net's region-based training).
    return {int(label) for label in value} if isinstance(value, list) else {int(value)}


def _paired(root: Path, dataset: NnUNet) -> tuple[Pairing, dict[str, str]]:
    """Image and label file of each case, sorted by case, and the role of the folder they are in."""
    ending = _described(root / "dataset.json", dataset.target).ending
    found, role_of = Pairing({}), {}
    for part, role in FOLDERS.items():
        images, labels = root / f"images{part}", root / f"labels{part}"
        if part != "Tr" and not (images.is_dir() and labels.is_dir()):
            continue
        named = {_case(path, ending): path for path in reading.image_files(images).values()}
        others = (*reading.other_files(images), *reading.other_files(labels))
        own = pair(named, reading.image_files(labels), others)
        for case, (path, _) in own.pairs.items():
            if case in found.pairs:
                raise InputError(f"{path}: expected a case of another name than {found.pairs[case][0]}")
            role_of[case] = role
        found += own
    pairing = Pairing(dict(sorted(found.pairs.items())), found.images, found.masks, found.others)
    return pairing.settled(dataset.unpaired, root), role_of


def _case(path: Path, ending: str) -> str:
    if path.suffix != ending or not path.stem.endswith(CHANNEL):
        raise InputError(f"{path}: expected one image a case, <case>{CHANNEL}{ending}, received another name")
    return same_name(path.stem.removesuffix(CHANNEL))
