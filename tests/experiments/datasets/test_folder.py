from pathlib import Path

import numpy as np
import pytest
from dicom_files import region, write_dicom
from PIL import Image

from experiments.datasets.folder import Folder
from experiments.errors import InputError

TABLE = "case,group\na,p1\nb,p1\nc,p2\n"


def write_set(root: Path, table: str | None = TABLE, value: int = 255) -> Path:
    for name in ("images", "masks"):
        (root / name).mkdir(parents=True)
    for index, case in enumerate("abc"):
        image = np.full((10 + index, 12), 50 * index, np.uint8)
        mask = np.zeros(image.shape, np.uint8)
        mask[2:4, 5:8] = value
        Image.fromarray(image).save(root / "images" / f"{case}.jpg")
        Image.fromarray(mask).save(root / "masks" / f"{case}.png")
    if table is not None:
        (root / "groups.csv").write_text(table)
    return root


@pytest.mark.parametrize("value", [1, 255])
def test_reads_images_masks_and_groups(tmp_path, value: int) -> None:
    frames = Folder(str(write_set(tmp_path / "set", value=value)))()
    assert frames.case_ids == ("a", "b", "c") and frames.groups == ("p1", "p1", "p2")
    assert [int(mask.sum()) for mask in frames.masks] == [6] * 3
    assert frames.spacing_mm == (None,) * 3 and not frames.simulated


def test_spacing_is_one_for_all_or_that_of_the_table(tmp_path) -> None:
    root = write_set(tmp_path / "set")
    assert Folder(str(root), spacing_mm=[0.1, 0.2])().spacing_mm == ((0.1, 0.2),) * 3
    table = "case,group,vertical_mm,horizontal_mm\na,p,0.1,0.2\nb,p,0.3,0.4\nc,q,0.5,0.6\n"
    frames = Folder(str(write_set(tmp_path / "table", table)))()
    assert frames.spacing_mm == ((0.1, 0.2), (0.3, 0.4), (0.5, 0.6))


def write_films(root: Path, table: str = "case,group\nclip,p1\nstill,p2\n") -> Path:
    for name in ("images", "masks"):
        (root / name).mkdir(parents=True)
    film = np.stack([np.full((10, 12), 20 * index, np.uint8) for index in range(4)])
    tissue = region((0, 0, 9, 11), (0.02, 0.01))
    write_dicom(root / "images" / "clip.dcm", film, regions=(tissue,))
    write_dicom(root / "images" / "still.dcm", film[3])
    for index, name in enumerate(("clip_0001", "clip_0003", "still")):
        mask = np.zeros((10, 12), np.uint8)
        mask[index : index + 2, 5:8] = 1
        Image.fromarray(mask).save(root / "masks" / f"{name}.png")
    (root / "groups.csv").write_text(table)
    return root


def test_the_labelled_frames_of_a_dicom_film_are_cases_of_one_group(tmp_path) -> None:
    frames = Folder(str(write_films(tmp_path / "set")), spacing_mm=[0.3, 0.3])()
    assert frames.case_ids == ("clip_0001", "clip_0003", "still")
    assert frames.groups == ("p1", "p1", "p2")
    assert [int(image[0, 0]) for image in frames.images] == [20, 60, 60]
    assert [int(np.argmax(mask.any(axis=1))) for mask in frames.masks] == [0, 1, 2]
    # What the file says goes before what is set for all.
    assert frames.spacing_mm[0] == pytest.approx((0.2, 0.1)) == frames.spacing_mm[1]
    assert frames.spacing_mm[2] == (0.3, 0.3)


def test_the_table_goes_before_what_a_dicom_file_says(tmp_path) -> None:
    table = "case,group,vertical_mm,horizontal_mm\nclip,p1,0.5,0.6\nstill,p2,0.7,0.8\n"
    frames = Folder(str(write_films(tmp_path / "set", table)))()
    assert frames.spacing_mm == ((0.5, 0.6), (0.5, 0.6), (0.7, 0.8))


def test_refuses_a_film_without_masks_and_masks_without_their_frame(tmp_path) -> None:
    root = write_films(tmp_path / "set")
    (root / "masks" / "clip_0001.png").rename(root / "masks" / "clip_0004.png")
    with pytest.raises(InputError, match=r"no image for 1 mask \(masks/clip_0004\.png\); pass dataset"):
        Folder(str(root))()
    assert Folder(str(root), unpaired="skip")().case_ids == ("clip_0003", "still")
    (root / "masks" / "clip_0004.png").unlink()
    (root / "masks" / "clip_0003.png").unlink()
    with pytest.raises(InputError, match=r"no mask for 1 image \(images/clip\.dcm\); pass dataset"):
        Folder(str(root))()
    dataset = Folder(f"{root}/.", unpaired="skip")
    assert dataset().case_ids == ("still",) and dataset.left_out() == 1


def test_dicom_files_are_found_by_their_content(tmp_path) -> None:
    root = write_films(tmp_path / "set", "case,group\nclip,p1\n1.2.840.7,p2\n")
    (root / "images" / "clip.dcm").rename(root / "images" / "clip")
    (root / "images" / "still.dcm").rename(root / "images" / "1.2.840.7")
    (root / "masks" / "still.png").rename(root / "masks" / "1.2.840.7.png")
    (root / "images" / "DICOMDIR").write_bytes(b"\0" * 128 + b"DICM")
    frames = Folder(str(root))()
    assert frames.case_ids == ("1.2.840.7", "clip_0001", "clip_0003")
    assert frames.groups == ("p2", "p1", "p1")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            lambda root: (root / "masks" / "b.png").unlink(),
            r"found no mask for 1 image \(images/b\.jpg\); pass dataset\.unpaired=skip",
        ),
        (lambda root: (root / "images" / "b.jpg").unlink(), r"found no image for 1 mask \(masks/b\.png\)"),
        (
            lambda root: (root / "images" / "b.jpg").write_bytes(b"no image"),
            r"b\.jpg: expected an image, received",
        ),
        (
            lambda root: Image.fromarray(np.zeros((9, 12), np.uint8)).save(root / "masks" / "b.png"),
            r"b\.png: expected the mask to have its image's size 12x11, received 12x9",
        ),
        (
            lambda root: [
                Image.fromarray(np.zeros((10 + index, 12), np.uint8)).save(root / "masks" / f"{case}.png")
                for index, case in enumerate("abc")
            ],
            "masks: expected masks with a vessel, received 3 empty ones",
        ),
    ],
)
def test_refuses_pairs_that_do_not_fit_by_name(tmp_path, damage, message: str) -> None:
    root = write_set(tmp_path / "set")
    damage(root)
    with pytest.raises(InputError, match=message):
        Folder(str(root))()


def test_what_has_no_partner_may_be_left_out(tmp_path) -> None:
    root = write_set(tmp_path / "set")
    (root / "masks" / "b.png").rename(root / "masks" / "z.png")
    (root / "images" / "notes.txt").write_text("x")
    with pytest.raises(
        InputError,
        match=r"no mask for 1 image \(images/b\.jpg\) and no image for 1 mask \(masks/z\.png\), with 1 file of another "
        r"kind \(images/notes\.txt\)",
    ):
        Folder(str(root))()
    dataset = Folder(str(root), unpaired="skip")
    assert dataset().case_ids == ("a", "c") and dataset.left_out() == 2 and len(dataset.notes()) == 2
    for name in "ac":
        (root / "masks" / f"{name}.png").unlink()
    with pytest.raises(
        InputError, match="expected images and masks of the same names, found no mask for 3 images"
    ):
        Folder(f"{root}/.", unpaired="skip")()


def test_names_that_look_alike_are_the_same(tmp_path) -> None:
    """macOS writes an accent as a character of its own."""
    root = write_set(tmp_path / "set", "case,group\na,p\nb\u00e9,q\nc,r\n")
    (root / "images" / "b.jpg").rename(root / "images" / "be\u0301.jpg")
    (root / "masks" / "b.png").rename(root / "masks" / "b\u00e9.png")
    assert Folder(str(root))().case_ids == ("a", "b\u00e9", "c")
    table = root / "groups.csv"
    table.write_text(table.read_text().replace("b\u00e9", "be\u0301"))
    assert Folder(f"{root}/.")().groups == ("p", "q", "r")


def test_groups_are_named_as_the_table_writes_them(tmp_path) -> None:
    frames = Folder(str(write_set(tmp_path / "set", "case,group\na,1.10\nb,010\nc,1e3\n")))()
    assert frames.groups == ("1.10", "010", "1e3")


def test_labels_of_choice(tmp_path) -> None:
    root = write_set(tmp_path / "set", value=4)
    with pytest.raises(InputError, match=r"a\.png: expected labels 0, 1, 255, received 4"):
        Folder(str(root))()
    assert Folder(str(root), vessel_labels=[4], other_labels=[0, 3])().masks[0].sum() == 6


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (None, r"groups\.csv: expected a table with columns case, group, found no file"),
        ("name,subject\na,1\n", r"groups\.csv: expected columns case, group, received name, subject"),
        ("", r"groups\.csv: expected columns case, group, received none"),
        ("case,group\na,p\nb,p\n", r"groups\.csv: expected a group for image 'c', found none"),
        (
            "case,group\na,p\nb,p\na,q\nc,q\n",
            r"groups\.csv: expected one row for each case, received two for 'a'",
        ),
        ("case,group\na,p\nb,\nc,q\n", r"groups\.csv: expected a group for image 'b', found none"),
        (
            "case,group,vertical_mm,horizontal_mm\na,p,x,1\nb,p,1,1\nc,q,1,1\n",
            r"groups\.csv: a: expected two pixel sizes in mm",
        ),
        (
            "case,group,vertical_mm,horizontal_mm\na,p,0,1\nb,p,1,1\nc,q,1,1\n",
            r"groups\.csv: a: expected positive pixel sizes in mm, received 0\.0 x 1\.0",
        ),
    ],
)
def test_refuses_a_table_by_name(tmp_path, table: str | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Folder(str(write_set(tmp_path / "set", table)))()


def test_refuses_a_table_that_is_no_text(tmp_path) -> None:
    root = write_set(tmp_path / "set")
    (root / "groups.csv").write_bytes(b"case,group\na,\xff\xfe\n")
    with pytest.raises(InputError, match=r"groups\.csv: expected text in UTF-8"):
        Folder(str(root))()


def test_refuses_a_missing_root_and_settings(tmp_path) -> None:
    with pytest.raises(InputError, match=r"found no folder .*none; pass dataset\.root="):
        Folder(str(tmp_path / "none"))()
    with pytest.raises(InputError, match="vessel_labels: expected labels that are not among other_labels"):
        Folder("x", vessel_labels=[1], other_labels=[0, 1])
    with pytest.raises(InputError, match="spacing_mm: expected positive pixel sizes"):
        Folder("x", spacing_mm=[0.1, -0.1])
    with pytest.raises(InputError, match="spacing_mm: expected two pixel sizes"):
        Folder("x", spacing_mm=[0.1])


def test_sizes_known_for_some_and_groups_kept_outside_the_folds(tmp_path) -> None:
    root = write_set(tmp_path / "set")
    names = sorted(path.stem for path in (root / "images").iterdir())
    roles = ["test", "selection", ""]
    rows = [
        f"{name},p{index},{'0.2,0.1' if index else ','},{roles[min(index, 2)]}"
        for index, name in enumerate(names)
    ]
    (root / "groups.csv").write_text("case,group,vertical_mm,horizontal_mm,role\n" + "\n".join(rows) + "\n")
    dataset = Folder(str(root))
    frames = dataset()
    assert frames.spacing_mm == (None, *[(0.2, 0.1)] * (len(names) - 1))
    assert dataset.test_groups() == ("p0",)
    assert dataset.selection_groups() == ("p1",)
