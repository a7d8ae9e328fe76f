import numpy as np
import pytest
from dataset_layouts import (
    CAROTID,
    DAMAGE_NAMES,
    DAMAGES,
    LONELY,
    LONELY_NAMES,
    grey,
    speckle,
    write_carotid,
)
from drawn_sweeps import draw_sweeps

from experiments.datasets.carotid import Carotid, subject_groups
from experiments.datasets.protocol import reported_name
from experiments.datasets.simulated import SimulatedSubstitute
from experiments.errors import InputError

FIRST, SECOND, THIRD = "202201121748100022VAS", "202201121755300023EM VASCULAR", "202202010900000001VAS"


def test_reads_the_published_layout_in_order_of_time(tmp_path) -> None:
    root = write_carotid(tmp_path, {SECOND: 40, FIRST: 60, THIRD: 100})
    frames = Carotid(str(root))()
    assert len(frames) == 200 and not frames.simulated and frames.spacing_mm == (None,) * 200
    assert frames.case_ids[0] == f"{FIRST}_slice_5" and frames.case_ids[6] == f"{FIRST}_slice_11"
    assert frames.case_ids[60] == f"{SECOND}_slice_5"
    # The second recording was drawn first: its speckle says that images stay with their names.
    np.testing.assert_array_equal(frames.images[61], speckle(1))
    assert {int(mask.sum()) for mask in frames.masks} == {4}
    assert frames.groups == ("subject_01",) * 100 + ("subject_02",) * 100


def test_the_folder_may_be_named_itself_or_by_the_one_around_it(tmp_path) -> None:
    root = write_carotid(tmp_path, {THIRD: 100})
    assert Carotid(str(root))().digest() == Carotid(str(root / CAROTID))().digest()
    assert Carotid(str(root)).require_root() == root / CAROTID


def test_hundreds_are_filled_in_order_of_time() -> None:
    counts = {"d": 100, "a": 30, "b": 29, "c": 41, "f": 50, "e": 50}
    groups = subject_groups(counts)
    assert groups == {
        "a": "subject_01",
        "b": "subject_01",
        "c": "subject_01",
        "d": "subject_02",
        "e": "subject_03",
        "f": "subject_03",
    }


def test_the_published_numbers_give_eleven_groups() -> None:
    # 38 recordings and 1100 images: five subjects of four recordings, six of three.
    parts = [[25, 25, 25, 25]] * 5 + [[30, 30, 40]] * 6
    counts = [count for subject in parts for count in subject]
    groups = subject_groups({f"{index:03d}": count for index, count in enumerate(counts)})
    assert len(groups) == 38 and sum(counts) == 1100 and len(set(groups.values())) == 11


@pytest.mark.parametrize(
    ("counts", "found"),
    [
        ({"a": 60, "b": 50}, "received 110 with recording 'b', for subject 1"),
        ({"a": 200}, "received 200 with recording 'a', for subject 1"),
    ],
)
def test_counts_that_do_not_fill_hundreds_are_refused_with_the_way_out(counts: dict, found: str) -> None:
    with pytest.raises(
        InputError, match=rf"100 images for each subject.*{found}; pass dataset.group_by=recording"
    ):
        subject_groups(counts)


def test_recordings_as_groups_need_no_hundreds(tmp_path) -> None:
    root = write_carotid(tmp_path, {FIRST: 3, SECOND: 2})
    frames = Carotid(str(root), group_by="recording")()
    assert frames.groups == (FIRST,) * 3 + (SECOND,) * 2


def test_a_last_subject_with_fewer_images_is_a_smaller_group_and_the_notes_say_so(tmp_path) -> None:
    root = write_carotid(tmp_path, {FIRST: 60, SECOND: 40, THIRD: 43})
    dataset = Carotid(str(root))
    frames = dataset()
    assert frames.groups == ("subject_01",) * 100 + ("subject_02",) * 43
    assert dataset.left_out() == 0
    assert dataset.notes()[1] == "The copy is incomplete: its last subject, subject_02, has 43 of 100 images."
    assert len(Carotid(str(root), group_by="recording").notes()) == 1


def test_a_real_copy_is_told_of_at_once_and_can_be_gone_on_with(tmp_path) -> None:
    root = write_carotid(tmp_path, {FIRST: 60, SECOND: 40, THIRD: 43}) / CAROTID
    images = root / "US images"
    copies = [f"{FIRST}_slice_{number} - Copy.png" for number in (5, 6)]
    for name in copies:
        grey(images / name, speckle(1))
    for number in (7, 8, 9):
        (images / f"{SECOND}_slice_{number}.png").unlink()
    (images / "unet_model.h5").write_bytes(b"HDF")
    (images / ".DS_Store").write_bytes(b"")
    (images / "Thumbs.db").write_bytes(b"")
    with pytest.raises(InputError) as refusal:
        Carotid(str(root))()
    said = str(refusal.value)
    for part in (
        f"no mask for 2 images ({', '.join(f'US images/{name}' for name in copies)})",
        "no image for 3 masks (",
        *(f"Expert mask images/{SECOND}_slice_{number}.png" for number in (7, 8, 9)),
        "with 1 file of another kind (US images/unet_model.h5)",
        "its last subject, subject_02, has 43 of 100 images",
        "pass dataset.unpaired=skip to go on without them",
    ):
        assert part in said
    dataset = Carotid(str(root), unpaired="skip")
    frames = dataset()
    # The lost images of the second recording do not move the border between subjects.
    assert frames.groups == ("subject_01",) * 97 + ("subject_02",) * 43
    assert dataset.left_out() == 5 and reported_name(dataset) == "carotid (5 unpaired left out)"
    assert dataset.notes()[1:] == (
        "Left out as unpaired: 2 images without a mask and 3 masks without an image.",
        "Not used: 1 file of another kind (US images/unet_model.h5).",
        "The copy is incomplete: its last subject, subject_02, has 43 of 100 images.",
    )


def test_the_real_half_of_the_set_is_five_whole_subjects(real_data) -> None:
    dataset = Carotid(str(real_data / "carotid"))
    frames = dataset()
    assert {frames.groups.count(group) for group in set(frames.groups)} == {100}
    assert len(set(frames.groups)) == 5 and dataset.left_out() == 0 and len(dataset.notes()) == 1
    assert {image.shape for image in frames.images} == {(749, 709)}
    assert all(mask.any() for mask in frames.masks)
    percent = np.quantile([100 * mask.mean() for mask in frames.masks], [0.05, 0.95])
    np.testing.assert_allclose(percent, [1.7, 3.4], atol=0.05)


def test_the_notes_say_how_groups_came_about() -> None:
    assert Carotid("x").notes()[0].startswith("Groups are built, not published")
    assert Carotid("x", group_by="recording").notes()[0].startswith("Subject leakage possible")


def test_a_missing_root_is_one_sentence_with_source_licence_layout_and_override(tmp_path) -> None:
    with pytest.raises(InputError) as refusal:
        Carotid(str(tmp_path / "none"))()
    for part in ("carotid", "Mendeley Data d4xt63mgjm", "CC BY 4.0", f"{CAROTID}/US images", "dataset.root="):
        assert part in str(refusal.value)


@pytest.mark.parametrize("name, damage, message", DAMAGES, ids=DAMAGE_NAMES)
def test_a_bad_file_is_named(tmp_path, name: str, damage, message: str) -> None:
    root = write_carotid(tmp_path, {FIRST: 3}) / CAROTID
    file = f"{FIRST}_slice_6.png"
    damage(root / "US images" / file, root / "Expert mask images" / file)
    with pytest.raises(InputError, match=rf"{file}: .*{message}"):
        Carotid(str(root), group_by="recording")()


@pytest.mark.parametrize("name, damage, message", LONELY, ids=LONELY_NAMES)
def test_what_has_no_partner_is_refused_or_left_out(tmp_path, name: str, damage, message: str) -> None:
    root = write_carotid(tmp_path, {FIRST: 3}) / CAROTID
    file = f"{FIRST}_slice_6.png"
    damage(root / "US images" / file, root / "Expert mask images" / file)
    with pytest.raises(InputError, match=rf"{message} .*{file}\); pass dataset\.unpaired=skip"):
        Carotid(str(root), group_by="recording")()
    dataset = Carotid(str(root), group_by="recording", unpaired="skip")
    assert len(dataset()) == 2 and dataset.left_out() == 1
    with pytest.raises(InputError, match="unpaired: expected refuse or skip, received 'drop'"):
        Carotid("x", unpaired="drop")


def test_refuses_empty_masks_and_names_of_another_kind(tmp_path) -> None:
    empty = write_carotid(tmp_path / "empty", {FIRST: 2}, value=0)
    with pytest.raises(
        InputError, match="Expert mask images: expected masks with a vessel, received 2 empty ones"
    ):
        Carotid(str(empty), group_by="recording")()
    other = write_carotid(tmp_path / "other", {"20220112VAS": 1})
    with pytest.raises(InputError, match=r"slice_5\.png: expected a name YYYYMMDDhhmmss, four digits, VAS"):
        Carotid(str(other))()
    with pytest.raises(InputError, match="group_by: expected subject or recording, received 'person'"):
        Carotid("x", group_by="person")


def test_the_substitute_has_the_real_sets_names_and_groups(tmp_path, monkeypatch) -> None:
    draw_sweeps(monkeypatch)
    maker = SimulatedSubstitute(subjects=2, recordings=2, frames=2, size_px=32, cache=str(tmp_path))
    dataset = Carotid(str(tmp_path / "none"), simulate=True, substitute=maker)
    frames = dataset()
    assert dataset.require_root() is None and dataset.name == "carotid" and frames.simulated
    assert frames.groups == ("subject_01",) * 4 + ("subject_02",) * 4
    assert frames.case_ids[:3] == (
        "200001011000000001VAS_slice_0",
        "200001011000000001VAS_slice_1",
        "200001011005000002EM VASCULAR_slice_0",
    )
    assert dataset.notes()[0].startswith("Simulated: no image of carotid was used")
    by_recording = Carotid("x", group_by="recording", simulate=True, substitute=maker)()
    assert len(set(by_recording.groups)) == 4
