from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from experiments.datasets.images.image_similarity import correlations
from experiments.datasets.usgra import Usgra
from experiments.errors import InputError


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is read is kept in a folder of the test's own."""
    monkeypatch.setenv("CTUS_HOME", str(tmp_path / "home"))


def write_set(root: Path, count: int = 3, label: int = 2) -> Path:
    rng = np.random.default_rng(0)
    for name in ("images", "masks"):
        (root / name).mkdir(parents=True)
    for index in range(count):
        image = rng.integers(0, 255, (20 + index, 30), dtype=np.uint8)
        mask = np.zeros(image.shape, np.uint8)
        mask[2:5, 3:9], mask[10:12, 10:20] = label, 1
        Image.fromarray(np.dstack([image] * 3)).save(root / "images" / f"{index:04d}.png")
        Image.fromarray(mask).save(root / "masks" / f"{index:04d}.png")
    return root


def test_reads_the_label_of_the_target(tmp_path) -> None:
    root = write_set(tmp_path / "usgra")
    vessel, nerve = Usgra(str(root))(), Usgra(str(root), target="nerve")()
    assert vessel.case_ids == ("0000", "0001", "0002") and not vessel.simulated
    assert [image.shape for image in vessel.images] == [(20, 30), (21, 30), (22, 30)]
    assert vessel.spacing_mm == (None,) * 3
    assert [int(mask.sum()) for mask in vessel.masks] == [18] * 3
    assert [int(mask.sum()) for mask in nerve.masks] == [20] * 3


def test_a_missing_root_is_one_sentence_with_source_licence_layout_and_override(tmp_path) -> None:
    with pytest.raises(InputError) as refusal:
        Usgra(str(tmp_path / "none"))()
    said = str(refusal.value)
    for part in ("usgra", "tmkand/usgra-seg", "CC BY 4.0", "masks/*.png", "dataset.root=", "none"):
        assert part in said
    assert "\n" not in said


def test_refuses_files_by_name(tmp_path) -> None:
    root = write_set(tmp_path / "labels", label=3)
    with pytest.raises(InputError, match=r"0000\.png: expected labels 0, 1, 2, received 3"):
        Usgra(str(root))()
    root = write_set(tmp_path / "size")
    Image.fromarray(np.zeros((5, 5), np.uint8)).save(root / "masks" / "0001.png")
    with pytest.raises(
        InputError, match=r"0001\.png: expected the mask to have its image's size 30x21, received 5x5"
    ):
        Usgra(str(root))()
    root = write_set(tmp_path / "pair")
    (root / "masks" / "0002.png").unlink()
    with pytest.raises(
        InputError, match=r"no mask for 1 image \(images/0002\.png\); pass dataset\.unpaired=skip"
    ):
        Usgra(str(root))()
    dataset = Usgra(str(root), unpaired="skip")
    assert "0002" not in dataset().case_ids and dataset.left_out() == 1
    assert dataset.notes()[-1] == "Left out as unpaired: 1 image without a mask and 0 masks without an image."
    root = write_set(tmp_path / "empty", label=0)
    with pytest.raises(InputError, match="masks: expected masks with a vessel, received 3 empty ones"):
        Usgra(str(root))()


def test_refuses_settings() -> None:
    with pytest.raises(InputError, match="target: expected one of nerve, vessel, received 'bone'"):
        Usgra("x", target="bone")
    with pytest.raises(InputError, match=r"duplicate_correlation: expected above 0 to 1, received 1\.5"):
        Usgra("x", duplicate_correlation=1.5)


def test_the_real_set_has_what_is_published_of_it(real_data) -> None:
    frames = Usgra(str(real_data / "usgra"))()
    assert len(frames) == 204
    assert sum(mask.any() for mask in frames.masks) == 183
    assert len({image.shape for image in frames.images}) == 3
    alike = correlations(frames.images) > 0.9
    assert 0.18 < (alike.sum(axis=0) > 1).mean() < 0.22
    groups = np.array(frames.groups)
    first, second = np.nonzero(alike)
    assert (groups[first] == groups[second]).all()
    assert len(set(frames.groups)) > 170


def test_real_pictures_saved_twice_are_in_one_group(real_data) -> None:
    """Seen by eye: one picture, 512 pixels wide and 534 with a margin; stretched thumbnails correlate below 0.9."""
    frames = Usgra(str(real_data / "usgra"))()
    group_of = dict(zip(frames.case_ids, frames.groups, strict=True))
    place = {case: index for index, case in enumerate(frames.case_ids)}
    for first, second in (("0007", "0061"), ("0023", "0109"), ("0033", "0140"), ("0037", "0147")):
        assert group_of[first] == group_of[second]
        assert correlations([frames.images[place[case]] for case in (first, second)])[0, 1] < 0.9
    # Of 1 to 3 images each: nothing is chained into one large group.
    sizes = [frames.groups.count(group) for group in set(frames.groups)]
    assert max(sizes) == 3 and sum(size > 1 for size in sizes) == 27


def test_says_that_no_subjects_are_known() -> None:
    (note,) = Usgra("x").notes()
    assert note.startswith("Subject leakage possible") and "above 0.9" in note


def test_images_load_once(tmp_path) -> None:
    root = write_set(tmp_path / "usgra")
    assert Usgra(str(root))() is Usgra(str(root))()
