"""A data set written as files: nnU-Net's raw layout, or the project's own folder."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from experiments.datasets.group_table import GroupRow, write_groups
from experiments.datasets.nnunet import CHANNEL, FOLDERS
from experiments.errors import InputError
from experiments.files import write_text
from experiments.outcome import Progress
from experiments.splits.nnunet import FILE_NAME, to_nnunet
from experiments.splits.split_set import SplitSet
from models.labelled_frames import LabelledFrames

SPLITS = "splits.json"
SCRIPT = "run_nnunet.sh"
_ROLES = {"selection": "selection", "held_out": "test"}


@dataclass(frozen=True)
class NnUNetExport:
    """Export in the layout of nnU-Net: a folder ``DatasetXXX_Name`` with the commands to run.

    Parameters
    ----------
    number : int
        The XXX, 1 to 999.
    title : str
        The Name: letters, digits, ``-`` and ``_``.
    target : str
        What label 1 is called.

    Raises
    ------
    InputError
        If a setting is not one that nnU-Net takes.

    Notes
    -----
    Next to nnU-Net's own files are ``groups.csv`` (group, pixel size, role and original name of each case)
    and ``splits.json`` (all folds as this project has them). Test groups go to ``imagesTs`` and ``labelsTs``,
    selection groups to folders that nnU-Net ignores.
    """

    number: int
    title: str
    target: str

    def __post_init__(self) -> None:
        if not 1 <= self.number <= 999:
            raise InputError(f"number: expected a data set number of 1 to 999, received {self.number}")
        for name in ("title", "target"):
            if not re.fullmatch(r"[A-Za-z0-9]+([_-][A-Za-z0-9]+)*", getattr(self, name)):
                raise InputError(
                    f"{name}: expected letters, digits, - and _, received {getattr(self, name)!r}"
                )
        if self.target == "background":
            raise InputError("target: expected another name than that of label 0, received 'background'")

    @property
    def folder(self) -> str:
        """The folder's name."""
        return f"Dataset{self.number:03d}_{self.title}"

    def __call__(self, out: Path, frames: LabelledFrames, splits: SplitSet, progress: Progress) -> Path:
        """Write the folder.

        Parameters
        ----------
        out : Path
            The folder to write ``DatasetXXX_Name`` into.
        frames : LabelledFrames
            All cases.
        splits : SplitSet
            The folds, of one outer fold where they are nested.
        progress : Progress
            Shows how many images are written.

        Returns
        -------
        Path
            The folder written.
        """
        root = out / self.folder
        names = safe_names(frames.case_ids)
        roles = roles_of(splits)
        part_of = {role: part for part, role in FOLDERS.items()}
        for case, image, mask in _pictures(frames, progress):
            part = part_of[roles[case]]
            _save(root / f"images{part}" / f"{names[case]}{CHANNEL}.png", image)
            _save(root / f"labels{part}" / f"{names[case]}.png", mask.astype(np.uint8))
        renamed = splits.renamed(names)
        count = sum(role == FOLDERS["Tr"] for role in roles.values())
        write_text(root / "dataset.json", json.dumps(self._described(count), indent=1))
        write_text(root / FILE_NAME, json.dumps(to_nnunet(renamed), indent=1))
        write_groups(root / "groups.csv", group_rows(frames, names, roles))
        renamed.write(root / SPLITS)
        write_text(root / SCRIPT, self._commands(len(splits), "test" in roles.values()))
        return root

    def _described(self, count: int) -> dict[str, object]:
        return {
            # Any name but CT has nnU-Net normalise each image by its own mean and deviation.
            "channel_names": {"0": "ultrasound"},
            "labels": {"background": 0, self.target: 1},
            "numTraining": count,
            "file_ending": ".png",
            "overwrite_image_reader_writer": "NaturalImage2DIO",
        }

    def _commands(self, folds: int, has_test: bool) -> str:
        numbers = " ".join(map(str, range(folds)))
        results = f"$nnUNet_results/{self.folder}/nnUNetTrainer__nnUNetPlans__2d"
        lines = [
            "#!/bin/sh",
            "# nnU-Net v2 (pip install nnunetv2) on this data set, on the very folds of splits_final.json.",
            "set -e",
            'here=$(cd "$(dirname "$0")" && pwd)',
            'export nnUNet_raw="$(dirname "$here")"',
            'export nnUNet_preprocessed="${nnUNet_preprocessed:-$nnUNet_raw/nnUNet_preprocessed}"',
            'export nnUNet_results="${nnUNet_results:-$nnUNet_raw/nnUNet_results}"',
            f"nnUNetv2_plan_and_preprocess -d {self.number} -c 2d --verify_dataset_integrity",
            f'cp "$here/{FILE_NAME}" "$nnUNet_preprocessed/{self.folder}/"',
            f"for fold in {numbers}; do",
            f"  nnUNetv2_train {self.number} 2d $fold",
            "done",
            f'echo "Out-of-fold masks: {results}/fold_*/validation"',
        ]
        if has_test:
            predicted = f'"{results}/test"'
            lines.append(
                f'nnUNetv2_predict -i "$here/imagesTs" -o {predicted} -d {self.number} -c 2d -f {numbers}'
            )
        return "\n".join(lines) + "\n"


def write_folder(
    out: Path, frames: LabelledFrames, splits: SplitSet | None, roles: Mapping[str, str], progress: Progress
) -> Path:
    """Write ``dataset``: ``images``, ``masks`` (0 and 255), ``groups.csv`` and, if given, ``splits.json``.

    Parameters
    ----------
    out : Path
        The folder to write ``dataset`` into.
    frames : LabelledFrames
        All cases.
    splits : SplitSet or None
        All folds.
    roles : mapping of str to str
        Role of each case, as ``roles_of`` returns it; cases may be missing.
    progress : Progress
        Shows how many images are written.

    Returns
    -------
    Path
        The folder written.
    """
    root = out / "dataset"
    names = safe_names(frames.case_ids)
    for case, image, mask in _pictures(frames, progress):
        _save(root / "images" / f"{names[case]}.png", image)
        _save(root / "masks" / f"{names[case]}.png", mask.astype(np.uint8) * 255)
    write_groups(root / "groups.csv", group_rows(frames, names, roles))
    if splits is not None:
        splits.renamed(names).write(root / SPLITS)
    return root


def safe_names(cases: Iterable[str]) -> dict[str, str]:
    """Choose a file name for each case, unique without regard to case.

    Parameters
    ----------
    cases : iterable of str
        Case names.

    Returns
    -------
    dict of str to str
        Names of letters, digits, ``-`` and ``_`` alone.
    """
    names: dict[str, str] = {}
    taken: set[str] = set()
    for case in cases:
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", case).strip("_") or "case"
        name, number = plain, 1
        while name.casefold() in taken:
            number += 1
            name = f"{plain}-{number}"
        taken.add(name.casefold())
        names[case] = name
    return names


def roles_of(splits: SplitSet) -> dict[str, str]:
    """Return the role of each case.

    Parameters
    ----------
    splits : SplitSet
        All folds.

    Returns
    -------
    dict of str to str
        ``cross-validation``, ``selection`` or ``test``.
    """
    return {case: _ROLES.get(side, FOLDERS["Tr"]) for case, side in splits.splits[0].sides()}


def group_rows(
    frames: LabelledFrames, names: Mapping[str, str], roles: Mapping[str, str]
) -> dict[str, GroupRow]:
    """Return the rows of ``groups.csv`` under the new names.

    Parameters
    ----------
    frames : LabelledFrames
        All cases.
    names : mapping of str to str
        New name of each case.
    roles : mapping of str to str
        Role of each case; cases may be missing.

    Returns
    -------
    dict of str to GroupRow
        Rows by new name, with the original name where it differs.
    """
    return {
        names[case]: GroupRow(group, spacing, roles.get(case, ""), case if case != names[case] else "")
        for case, group, spacing in zip(frames.case_ids, frames.groups, frames.spacing_mm, strict=True)
    }


def _pictures(frames: LabelledFrames, progress: Progress) -> Iterable[tuple[str, np.ndarray, np.ndarray]]:
    cases = zip(frames.case_ids, frames.images, frames.masks, strict=True)
    return progress.track(cases, "writing images", len(frames))


def _save(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)
