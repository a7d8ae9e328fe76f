"""Anyone's images and masks in two folders, with a table of what belongs together."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from experiments.datasets.content_key import cached_while_unchanged
from experiments.datasets.group_table import Spacing, groups_by_role, read_groups, spacing_pair
from experiments.datasets.images import image_files
from experiments.datasets.images.dicom import is_dicom, read_dicom
from experiments.datasets.pairing import REFUSE, Pairing, pair, require_choice
from experiments.errors import InputError
from experiments.paths import PathSetting
from models.labelled_frames import LabelledFrames


@dataclass(frozen=True)
class Folder:
    """``root/images`` and ``root/masks`` with files of the same names, and ``root/groups.csv``.

    Parameters
    ----------
    root : Path
        The folder of both and of the table.
    vessel_labels, other_labels : sequence of int
        Labels of the vessel and of all else that masks may hold.
    spacing_mm : sequence of float or None
        Pixel size (vertical, horizontal) where neither the table nor a DICOM file has one; None: not known.
    unpaired : {'refuse', 'skip'}
        Whether images without a mask and masks without an image are refused or left out.

    Raises
    ------
    InputError
        If a label is the vessel's and another's, or another setting is out of range.

    Notes
    -----
    The table has a row for each image with columns ``case`` (the name without suffix) and ``group`` (subject,
    session or recording), and may have ``vertical_mm`` and ``horizontal_mm``, the pixel size, and ``role``
    (see ``read_groups``).

    A DICOM file ``clip.dcm`` of several frames has one row, ``clip``, and thus one group; the masks of its
    frames are ``clip_0000``, ``clip_0001`` and so on, and frames without a mask are no cases.
    """

    root: PathSetting
    vessel_labels: Sequence[int] = (1, 255)
    other_labels: Sequence[int] = (0,)
    spacing_mm: Sequence[float] | None = None
    unpaired: str = REFUSE

    name: ClassVar[str] = "folder"

    def __post_init__(self) -> None:
        require_choice(self.unpaired)
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
        return image_files.require_root(
            self.name, self.root, "images of your own", "images/, masks/ of the same names, groups.csv"
        )

    def __call__(self) -> LabelledFrames:
        """Read the images and masks.

        Returns
        -------
        LabelledFrames
            All frames that have a mask.

        Raises
        ------
        InputError
            If a file or folder is not as expected; the message names it.
        """
        return _read(self).frames

    def test_groups(self) -> tuple[str, ...]:
        """Return the groups whose role is test.

        Returns
        -------
        tuple of str
            Group names, sorted.
        """
        return _read(self).roles["test"]

    def selection_groups(self) -> tuple[str, ...]:
        """Return the groups whose role is selection.

        Returns
        -------
        tuple of str
            Group names, sorted.
        """
        return _read(self).roles["selection"]

    def notes(self) -> tuple[str, ...]:
        """Return what was left out or is not used.

        Returns
        -------
        tuple of str
            Sentences.
        """
        return _read(self).pairing.notes(self.require_root())

    def left_out(self) -> int:
        """Count the images and masks that were left out because they had no partner.

        Returns
        -------
        int
            Number of files.
        """
        return _read(self).pairing.unpaired


@dataclass(frozen=True)
class _Picture:
    """One frame, the name of the file it is from, and the pixel size that the file gives."""

    image: np.ndarray
    file: str
    spacing_mm: Spacing | None


@dataclass(frozen=True)
class _Content:
    """The frames, the groups of each role, and what was paired and left over."""

    frames: LabelledFrames
    roles: dict[str, tuple[str, ...]]
    pairing: Pairing


def _files(dataset: Folder) -> tuple[Path, ...]:
    root = dataset.require_root()
    # Of a clip the pairing by name has the first mask alone.
    pairing, masks = _by_name(root), image_files.image_files(root / "masks")
    return (*pairing.files, *masks.values(), root / "groups.csv")


@cached_while_unchanged(_files)
def _read(dataset: Folder) -> _Content:
    root = dataset.require_root()
    # What can be refused by names alone is refused before any pixel is read.
    by_name = _by_name(root)
    by_name.settled(dataset.unpaired, root)
    files = {name: image for name, (image, _) in by_name.pairs.items()}
    masks = image_files.image_files(root / "masks")
    rows = read_groups(root / "groups.csv", files)
    pictures = _pictures(files, masks)
    pairing = _with_frames(by_name, pictures, files, masks).settled(dataset.unpaired, root)
    shown = tuple(
        image_files.read_mask(mask, dataset.vessel_labels, dataset.other_labels, pictures[case].image.shape)
        for case, (_, mask) in pairing.pairs.items()
    )
    image_files.require_vessel(root / "masks", shown)
    frames = LabelledFrames(
        images=tuple(picture.image for picture in pictures.values()),
        masks=shown,
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
    return _Content(frames, roles, pairing)


def _by_name(root: Path) -> Pairing:
    """Each file with a mask of its name; a DICOM clip with the first mask of a frame of it."""
    folders = root / "images", root / "masks"
    files, masks = (image_files.image_files(folder) for folder in folders)
    others = [path for folder in folders for path in image_files.other_files(folder)]
    clips = {name for name, path in files.items() if is_dicom(path)}
    clip_of = {mask: _clip_of(mask, clips) for mask in masks}
    of_clips = {clip: masks[mask] for mask, clip in reversed(clip_of.items()) if clip is not None}
    return pair(files, {name: masks[name] for name in masks if clip_of[name] is None} | of_clips, others)


def _clip_of(mask: str, clips: Collection[str]) -> str | None:
    return next((name for name in (mask, mask.rpartition("_")[0]) if name in clips), None)


def _with_frames(
    by_name: Pairing, pictures: Mapping[str, _Picture], files: Mapping[str, Path], masks: Mapping[str, Path]
) -> Pairing:
    """Return the pairing once the frames of clips are known, with masks of frames that no clip has."""
    shown = {picture.file for picture in pictures.values()}
    without = tuple(path for name, path in files.items() if name not in shown)
    frameless = tuple(
        path for name, path in masks.items() if name not in pictures and path not in by_name.masks
    )
    return Pairing(
        {case: (files[picture.file], masks[case]) for case, picture in pictures.items()},
        by_name.images + without,
        by_name.masks + frameless,
        by_name.others,
    )


def _pictures(files: Mapping[str, Path], masks: Mapping[str, Path]) -> dict[str, _Picture]:
    """Return the frames that have a mask, by case."""
    pictures: dict[str, _Picture] = {}
    for name, path in files.items():
        if not is_dicom(path):
            pictures[name] = _Picture(image_files.read_grey(path), name, None)
            continue
        clip = read_dicom(path)
        cases = (
            [name] if len(clip.images) == 1 else [f"{name}_{index:04d}" for index in range(len(clip.images))]
        )
        pictures |= {
            case: _Picture(np.ascontiguousarray(image), name, clip.spacing_mm)
            for case, image in zip(cases, clip.images, strict=True)
            if case in masks
        }
    return pictures
