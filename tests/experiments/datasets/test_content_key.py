"""What was read is kept within a process until one of its files changes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from dataset_layouts import CAROTID, grey, speckle, write_carotid, write_musv, write_san_raffaele

from experiments.datasets.carotid import Carotid
from experiments.datasets.content_key import cached_while_unchanged, content_key
from experiments.datasets.folder import Folder
from experiments.datasets.musv import MusV
from experiments.datasets.nnunet import NnUNet
from experiments.datasets.protocol import DataSet
from experiments.datasets.san_raffaele import SanRaffaele
from experiments.datasets.usgra import Usgra

RECORDING = "202201121748100021VAS"


def two_pairs(root: Path, images: str, masks: str, suffix: str = "") -> None:
    for index, name in enumerate("ab"):
        grey(root / images / f"{name}{suffix}.png", speckle(index))
        grey(root / masks / f"{name}.png", 2 * (speckle(index + 10) > 70))


def usgra(root: Path) -> tuple[DataSet, Path]:
    two_pairs(root, "images", "masks")
    return Usgra(str(root)), root / "masks" / "a.png"


def folder(root: Path) -> tuple[DataSet, Path]:
    two_pairs(root, "images", "masks")
    (root / "groups.csv").write_text("case,group\na,p\nb,q\n")
    return Folder(str(root), vessel_labels=[2], other_labels=[0]), root / "masks" / "a.png"


def nnunet(root: Path) -> tuple[DataSet, Path]:
    two_pairs(root, "imagesTr", "labelsTr", "_0000")
    described = {"channel_names": {"0": "x"}, "labels": {"background": 0, "vessel": 2}, "file_ending": ".png"}
    (root / "dataset.json").write_text(json.dumps(described))
    return NnUNet(str(root)), root / "labelsTr" / "a.png"


def carotid(root: Path) -> tuple[DataSet, Path]:
    write_carotid(root, {RECORDING: 2}, value=255)
    masks = root / CAROTID / "Expert mask images"
    return Carotid(str(root), group_by="recording"), masks / f"{RECORDING}_slice_5.png"


def musv(root: Path) -> tuple[DataSet, Path]:
    write_musv(root, {"001": ("train", 2, (10, 12)), "002": ("valid", 2, (10, 12))})
    return MusV(str(root), "artery"), root / "Annotations" / "001" / "001_000.png"


def san_raffaele(root: Path) -> tuple[DataSet, Path]:
    write_san_raffaele(root, [("v1", "ann", "", 4), ("v2", "ben", "", 3), ("v3", "cleo", "", 3)])
    return SanRaffaele(str(root), test_subjects=["cleo"]), root / "v1" / "masks" / "frame_0.png"


@pytest.mark.parametrize("written", [usgra, folder, nnunet, carotid, musv, san_raffaele])
def test_a_data_set_is_read_again_once_a_file_has_changed(
    tmp_path: Path, written: Callable[[Path], tuple[DataSet, Path]]
) -> None:
    dataset, mask = written(tmp_path)
    before = dataset()
    assert dataset() is before
    shape = before.masks[0].shape
    changed = np.zeros(shape)
    changed[:2] = 255 if written in (carotid, san_raffaele) else 2
    grey(mask, changed)
    after = dataset()
    assert after.masks[0].sum() == 2 * shape[1] and after.digest() != before.digest()
    np.testing.assert_array_equal(after.masks[1], before.masks[1])


def test_a_changed_table_is_read_again(tmp_path: Path) -> None:
    dataset, _ = folder(tmp_path)
    assert dataset().groups == ("p", "q")
    (tmp_path / "groups.csv").write_text("case,group\na,p\nb,other\n")
    assert dataset().groups == ("p", "other")


def test_a_key_is_of_paths_contents_and_purpose_and_files_may_be_missing(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    keys = {content_key([one]), content_key([one], "masks"), content_key([other]), content_key([one, other])}
    one.write_text("a")
    keys |= {content_key([one])}
    one.write_text("ab")
    keys |= {content_key([one])}
    assert len(keys) == 6 and content_key([one]) in keys


def test_results_used_last_are_kept(tmp_path: Path) -> None:
    calls: list[int] = []

    @cached_while_unchanged(lambda dataset: [tmp_path / "file"], maxsize=2)
    def read(dataset: int) -> int:
        calls.append(dataset)
        return dataset

    assert [read(number) for number in (1, 2, 1, 2, 3, 2, 1)] == [1, 2, 1, 2, 3, 2, 1]
    assert calls == [1, 2, 3, 1]
