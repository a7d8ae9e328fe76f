from pathlib import Path

import numpy as np
import pytest
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


def test_labels_of_choice(tmp_path) -> None:
    root = write_set(tmp_path / "set", value=4)
    with pytest.raises(InputError, match=r"a\.png: expected labels 0, 1, 255, received 4"):
        Folder(str(root))()
    assert Folder(str(root), vessel_labels=[4], other_labels=[0, 3])().masks[0].sum() == 6


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (None, r"groups\.csv: expected a table with columns case and group, found no file"),
        ("name,subject\na,1\n", r"groups\.csv: expected columns case and group, received name, subject"),
        ("", r"groups\.csv: expected columns case and group, received none"),
        ("case,group\na,p\nb,p\n", r"groups\.csv: expected a group for image 'c', found none"),
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


def test_refuses_a_missing_root_and_settings(tmp_path) -> None:
    with pytest.raises(InputError, match=r"found no folder .*none; pass dataset\.root="):
        Folder(str(tmp_path / "none"))()
    with pytest.raises(InputError, match="vessel_labels: expected labels that are not among other_labels"):
        Folder("x", vessel_labels=[1], other_labels=[0, 1])
    with pytest.raises(InputError, match="spacing_mm: expected positive pixel sizes"):
        Folder("x", spacing_mm=[0.1, -0.1])
    with pytest.raises(InputError, match="spacing_mm: expected two pixel sizes"):
        Folder("x", spacing_mm=[0.1])
