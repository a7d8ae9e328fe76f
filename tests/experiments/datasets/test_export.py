import dataclasses
import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from drawn_vessels import drawn_frames
from PIL import Image

from experiments.datasets.export import NnUNetExport, roles_of, safe_names, write_folder
from experiments.datasets.folder import Folder
from experiments.datasets.nnunet import NnUNet
from experiments.datasets.protocol import outside_groups
from experiments.errors import InputError
from experiments.outcome import Silent
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split_set import SplitSet
from models.labelled_frames import LabelledFrames

FRAMES = drawn_frames(24, per_group=2, empty=3)
RECIPE = GroupSplits(3, selection_share=0.2, test_share=0.25)


def same(left: LabelledFrames, right: LabelledFrames) -> bool:
    return left.digest() == right.digest()


def exported(out: Path, frames: LabelledFrames = FRAMES, recipe: GroupSplits = RECIPE) -> Path:
    return NnUNetExport(7, "drawn", "vessel")(out, frames, recipe(frames), Silent())


def test_nnunets_layout(tmp_path) -> None:
    root = exported(tmp_path)
    splits = RECIPE(FRAMES)
    assert root == tmp_path / "Dataset007_drawn"
    described = json.loads((root / "dataset.json").read_text())
    training = sorted(case for case, role in roles_of(splits).items() if role == "cross-validation")
    assert described["numTraining"] == len(training) == len(list((root / "imagesTr").iterdir()))
    assert described["labels"] == {"background": 0, "vessel": 1} and described["file_ending"] == ".png"
    assert described["channel_names"] == {"0": "ultrasound"}
    assert sorted(path.name for path in (root / "labelsTr").iterdir()) == [f"{case}.png" for case in training]
    held_out = sorted(splits.fold(0).held_out)
    assert sorted(path.name for path in (root / "imagesTs").iterdir()) == [
        f"{case}_0000.png" for case in held_out
    ]
    image = np.asarray(Image.open(root / "imagesTr" / f"{training[0]}_0000.png"))
    mask = np.asarray(Image.open(root / "labelsTr" / f"{training[-1]}.png"))
    np.testing.assert_array_equal(image, FRAMES.images[FRAMES.case_ids.index(training[0])])
    np.testing.assert_array_equal(mask, FRAMES.masks[FRAMES.case_ids.index(training[-1])].astype(np.uint8))
    lists = json.loads((root / "splits_final.json").read_text())
    assert [sorted((*one["train"], *one["val"])) for one in lists] == [training] * 3


def test_what_nnunet_gets_comes_back_as_it_was(tmp_path) -> None:
    root = exported(tmp_path)
    dataset = NnUNet(str(root), cache=None)
    frames = dataset()
    assert same(frames, dataclasses.replace(FRAMES, simulated=False))
    splits = RECIPE(FRAMES)
    for name in ("splits.json", "splits_final.json"):
        recipe = GroupSplits(5, file=str(root / name))
        assert recipe(frames, **outside_groups(dataset)) == splits


def test_names_that_nnunet_does_not_take_are_made_safe(tmp_path) -> None:
    names = [f"2001 EM/slice.{index}" for index in range(23)] + ["2001_EM_slice_0"]
    frames = dataclasses.replace(FRAMES, case_ids=tuple(names))
    dataset = NnUNet(str(exported(tmp_path, frames)), cache=None)
    read = dataset()
    assert read.case_ids[:2] == ("2001_EM_slice_0", "2001_EM_slice_1")
    assert read.case_ids[23] == "2001_EM_slice_0-2"
    table = (tmp_path / "Dataset007_drawn" / "groups.csv").read_text().splitlines()
    assert table[0] == "case,group,vertical_mm,horizontal_mm,role,original"
    assert table[1].startswith("2001_EM_slice_0,sweep0,0.5,0.25,") and table[1].endswith(",2001 EM/slice.0")
    splits = GroupSplits(file=str(tmp_path / "Dataset007_drawn" / "splits_final.json"))
    assert splits(read, **outside_groups(dataset)) == RECIPE(frames).renamed(safe_names(names))


def test_safe_names_are_unlike_in_whatever_case() -> None:
    assert safe_names(["a b", "a_b", "A_B", "../x", "ä"]) == {
        "a b": "a_b",
        "a_b": "a_b-2",
        "A_B": "A_B-3",
        "../x": "x",
        "ä": "case",
    }


def test_a_folder_comes_back_as_it_was(tmp_path) -> None:
    for spacing in ((0.5, 0.25), None):
        frames = dataclasses.replace(FRAMES, spacing_mm=(spacing,) * len(FRAMES))
        splits = RECIPE(frames)
        root = write_folder(tmp_path / str(spacing), frames, splits, roles_of(splits), Silent())
        read = Folder(str(root))()
        assert same(read, dataclasses.replace(frames, simulated=False))
        assert SplitSet.read(root / "splits.json") == splits


def test_nested_folds_are_exported_one_outer_fold_at_a_time(tmp_path) -> None:
    splits = GroupSplits(2, outer_folds=3)(FRAMES).of_outer_fold(1)
    root = NnUNetExport(7, "drawn", "vessel")(tmp_path, FRAMES, splits, Silent())
    dataset = NnUNet(str(root), cache=None)
    assert set(dataset.test_groups()) == {splits.splits[0].groups[case] for case in splits.splits[0].held_out}
    assert GroupSplits(file=str(root / "splits.json"))(dataset(), **outside_groups(dataset)) == splits


def test_the_commands_run_nnunet_on_every_fold(tmp_path) -> None:
    # Stand-ins for nnU-Net's programs write down how they were called.
    programs = tmp_path / "programs"
    programs.mkdir()
    for name in ("nnUNetv2_plan_and_preprocess", "nnUNetv2_train", "nnUNetv2_predict"):
        (programs / name).write_text(f'#!/bin/sh\necho "{name} $@" >> "{tmp_path}/calls"\n')
        (programs / name).chmod(0o755)
    root = exported(tmp_path / "a folder")
    prepared = tmp_path / "preprocessed" / "Dataset007_drawn"
    prepared.mkdir(parents=True)
    environment = {
        **os.environ,
        "PATH": f"{programs}:{os.environ['PATH']}",
        "nnUNet_preprocessed": str(prepared.parent),
        "nnUNet_results": str(tmp_path / "results"),
    }
    subprocess.run(["sh", str(root / "run_nnunet.sh")], check=True, env=environment, capture_output=True)
    calls = (tmp_path / "calls").read_text().splitlines()
    assert calls[0] == "nnUNetv2_plan_and_preprocess -d 7 -c 2d --verify_dataset_integrity"
    assert calls[1:4] == [f"nnUNetv2_train 7 2d {fold}" for fold in range(3)]
    assert calls[4].startswith(f"nnUNetv2_predict -i {root}/imagesTs -o ") and calls[4].endswith("-f 0 1 2")
    assert (prepared / "splits_final.json").read_bytes() == (root / "splits_final.json").read_bytes()


def test_without_test_groups_nothing_is_predicted(tmp_path) -> None:
    root = exported(tmp_path, recipe=GroupSplits(3))
    assert not (root / "imagesTs").exists()
    assert "nnUNetv2_predict" not in (root / "run_nnunet.sh").read_text()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ((0, "a", "vessel"), "number: expected a data set number of 1 to 999, received 0"),
        ((1000, "a", "vessel"), "number: expected a data set number of 1 to 999, received 1000"),
        ((1, "a b", "vessel"), "title: expected letters, digits, - and _, received 'a b'"),
        ((1, "a", "background"), "target: expected another name than that of label 0"),
    ],
)
def test_refuses_settings(settings: tuple[int, str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        NnUNetExport(*settings)
