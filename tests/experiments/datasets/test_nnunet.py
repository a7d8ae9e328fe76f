import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from experiments.datasets.nnunet import NnUNet
from experiments.datasets.protocol import outside_groups
from experiments.errors import InputError

LABELS = {"background": 0, "nerve": 1, "vessel": 2, "both": [1, 2], "ignore": 3}


def write_set(root: Path, ending: str = ".png", table: str | None = None, **changes: object) -> Path:
    """Three cases to train and one to test, all with three pixels of nerve and six of vessel."""
    described = {
        "channel_names": {"0": "US"},
        "labels": LABELS,
        "numTraining": 3,
        "file_ending": ending,
        **changes,
    }
    for part, cases in {"Tr": ["b", "a", "c_0000"], "Ts": ["t"]}.items():
        (root / f"images{part}").mkdir(parents=True)
        (root / f"labels{part}").mkdir()
        for index, case in enumerate(cases):
            image = np.full((8 + index, 12), 40 * index, np.uint8)
            mask = np.zeros(image.shape, np.uint8)
            mask[1, 1:4], mask[3:5, 5:8] = 1, 2
            Image.fromarray(image).save(root / f"images{part}" / f"{case}_0000{ending}")
            Image.fromarray(mask).save(root / f"labels{part}" / f"{case}{ending}")
    (root / "dataset.json").write_text(json.dumps(described))
    if table is not None:
        (root / "groups.csv").write_text(table)
    return root


def frames_of(root: Path, **changes: object):
    return NnUNet(str(root), cache=None, **changes)()


@pytest.mark.parametrize("ending", [".png", ".bmp", ".tif"])
def test_reads_training_and_test_cases(tmp_path, ending: str) -> None:
    root = write_set(tmp_path / "set", ending)
    frames = frames_of(root)
    assert frames.case_ids == ("a", "b", "c_0000", "t") == frames.groups
    assert [image.shape for image in frames.images] == [(9, 12), (8, 12), (10, 12), (8, 12)]
    assert [int(mask.sum()) for mask in frames.masks] == [6] * 4
    assert frames.spacing_mm == (None,) * 4 and not frames.simulated
    assert outside_groups(NnUNet(str(root), cache=None)) == {"selection_groups": (), "test_groups": ("t",)}


def test_a_description_with_a_byte_order_mark_is_read(tmp_path) -> None:
    file = write_set(tmp_path / "set") / "dataset.json"
    file.write_bytes(file.read_text().encode("utf-8-sig"))
    assert len(frames_of(tmp_path / "set").images) == 4


def test_the_target_is_a_label_or_a_region(tmp_path) -> None:
    root = write_set(tmp_path / "set")
    assert int(frames_of(root, target="nerve").masks[0].sum()) == 3
    assert int(frames_of(root, target="both").masks[0].sum()) == 9
    for target in ("background", "bone", "ignore"):
        with pytest.raises(InputError, match=r"expected a label of .*\(nerve, vessel, both\), received '"):
            frames_of(root, target=target)


def test_pixels_that_nobody_labelled_are_not_background_unasked(tmp_path) -> None:
    root = write_set(tmp_path / "set")
    path = root / "labelsTr" / "b.png"
    mask = np.array(Image.open(path))
    mask[0, :2] = 3
    Image.fromarray(mask).save(path)
    with pytest.raises(
        InputError,
        match=r"b\.png: expected every pixel labelled, received pixels of the label ignore in 1 of 4 images; pass "
        r"dataset\.ignored=skip .* dataset\.ignored=background",
    ):
        frames_of(root)
    skipped = NnUNet(str(root), ignored="skip")
    assert skipped().case_ids == ("a", "c_0000", "t")
    assert skipped.notes()[-1] == "1 images have pixels that are not labelled (ignore); they are left out."
    taken = NnUNet(str(root), ignored="background")
    assert [int(mask.sum()) for mask in taken().masks] == [6] * 4
    assert taken.notes()[-1].endswith("they count as background there.")
    with pytest.raises(InputError, match="ignored: expected refuse, skip or background, received 'vessel'"):
        NnUNet("x", ignored="vessel")


def test_what_has_no_partner_may_be_left_out(tmp_path) -> None:
    root = write_set(tmp_path / "set")
    (root / "labelsTr" / "a.png").unlink()
    (root / "imagesTs" / "u_0000.png").write_bytes((root / "imagesTs" / "t_0000.png").read_bytes())
    with pytest.raises(
        InputError, match=r"no mask for 2 images \(imagesTr/a_0000\.png, imagesTs/u_0000\.png\)"
    ):
        frames_of(root)
    dataset = NnUNet(str(root), unpaired="skip")
    assert dataset().case_ids == ("b", "c_0000", "t") and dataset.left_out() == 2
    assert "Left out as unpaired: 2 images without a mask" in " ".join(dataset.notes())


def test_groups_and_pixel_sizes_are_those_of_the_table(tmp_path) -> None:
    table = "case,group,vertical_mm,horizontal_mm\nt,p3,,\nb,p1,0.1,0.2\na,p2,,\nc_0000,p1,0.1,0.2\n"
    root = write_set(tmp_path / "set", table=table)
    frames = frames_of(root, spacing_mm=[0.5, 0.5])
    assert frames.case_ids == ("t", "b", "a", "c_0000") and frames.groups == ("p3", "p1", "p2", "p1")
    assert frames.spacing_mm == ((0.5, 0.5), (0.1, 0.2), (0.5, 0.5), (0.1, 0.2))
    assert NnUNet(str(root), cache=None).test_groups() == ("p3",)
    (tmp_path / "other.csv").write_text("case,group\na,q\nb,q\nc_0000,q\nt,r\n")
    assert frames_of(root, groups=str(tmp_path / "other.csv")).groups == ("q", "q", "q", "r")


def test_says_what_is_not_known_or_used(tmp_path) -> None:
    root = write_set(tmp_path / "set")
    (note,) = NnUNet(str(root)).notes()
    assert "each case is a group of its own" in note
    for path in (root / "labelsTs").iterdir():
        path.unlink()
    (root / "labelsTs").rmdir()
    assert "imagesTs is not used" in NnUNet(str(root)).notes()[1]
    assert frames_of(root).case_ids == ("a", "b", "c_0000")
    (root / "groups.csv").write_text("case,group\na,p\nb,p\nc_0000,p\n")
    assert len(NnUNet(str(root)).notes()) == 1


def test_refuses_a_group_to_train_and_to_test(tmp_path) -> None:
    root = write_set(tmp_path / "set", table="case,group\na,p1\nb,p2\nc_0000,p2\nt,p1\n")
    with pytest.raises(
        InputError,
        match="expected one role for group 'p1', found cases of it for cross-validation and for test",
    ):
        frames_of(root)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"file_ending": ".nii.gz"}, r"dataset\.json: expected a file_ending of \.png, \.bmp, \.tif"),
        ({"channel_names": {"0": "a", "1": "b"}}, r"dataset\.json: expected one channel, .* received 2"),
        ({"labels": ["vessel"]}, r"dataset\.json: expected JSON with channel_names, labels and file_ending"),
        ({"labels": {"background": 0, "vessel": 2}}, r"labelsTr.a\.png: expected labels 0, 2, received 1"),
    ],
)
def test_refuses_another_description(tmp_path, changes: dict[str, object], message: str) -> None:
    root = write_set(tmp_path / "set", **changes)
    with pytest.raises(InputError, match=message):
        frames_of(root)


def test_refuses_files_by_name(tmp_path) -> None:
    root = write_set(tmp_path / "channels")
    (root / "imagesTr" / "a_0000.png").rename(root / "imagesTr" / "a_0001.png")
    with pytest.raises(InputError, match=r"a_0001\.png: expected one image a case, <case>_0000\.png"):
        frames_of(root)
    root = write_set(tmp_path / "label")
    (root / "labelsTr" / "a.png").unlink()
    with pytest.raises(
        InputError, match=r"no mask for 1 image \(imagesTr/a_0000\.png\); pass dataset\.unpaired=skip"
    ):
        frames_of(root)
    root = write_set(tmp_path / "twice")
    for name, case in (("images", "a_0000"), ("labels", "a")):
        (root / f"{name}Ts" / f"{case}.png").write_bytes((root / f"{name}Tr" / f"{case}.png").read_bytes())
    with pytest.raises(InputError, match=r"imagesTs.a_0000\.png: expected a case of another name"):
        frames_of(root)
    (write_set(tmp_path / "described") / "dataset.json").unlink()
    with pytest.raises(InputError, match=r"dataset\.json: expected a file, received nothing there"):
        frames_of(tmp_path / "described")


def test_refuses_a_missing_root_and_settings(tmp_path) -> None:
    with pytest.raises(InputError, match=r"found no folder .*none; pass dataset\.root="):
        frames_of(tmp_path / "none")
    with pytest.raises(InputError, match="spacing_mm: expected positive pixel sizes"):
        NnUNet("x", spacing_mm=[0.1, -0.1])
