from pathlib import Path

import numpy as np
import pytest
from dataset_layouts import DAMAGE_NAMES, DAMAGES, LONELY, LONELY_NAMES, speckle, write_musv
from drawn_sweeps import draw_sweeps

from experiments.datasets import vessel_pair
from experiments.datasets.musv import LABELS, MusV
from experiments.datasets.simulated import SimulatedSubstitute
from experiments.errors import InputError

SEQUENCES = {"002": ("train", 3, (12, 10)), "001": ("valid", 2, (9, 14)), "010": ("train", 2, (12, 10))}
TABLE = "seq,volunteer,district\n001,anna,carotid\n002,anna,femoral\n010,ben,femoral\n"


def with_table(tmp_path: Path) -> str:
    (tmp_path / "subjects.csv").write_text(TABLE)
    return str(tmp_path / "subjects.csv")


def test_reads_both_parts_and_the_label_of_the_target(tmp_path) -> None:
    root = write_musv(tmp_path, SEQUENCES)
    artery, vein = MusV(str(root), "artery")(), MusV(str(root), "vein")()
    assert artery.case_ids == ("001_000", "001_001", "002_000", "002_001", "002_002", "010_000", "010_001")
    assert [image.shape for image in artery.images[1:3]] == [(9, 14), (12, 10)]
    np.testing.assert_array_equal(artery.images[3], speckle(1, (12, 10)))
    assert [int(mask.sum()) for mask in artery.masks] == [0, 4, 0, 4, 4, 0, 4]
    assert [int(mask.sum()) for mask in vein.masks] == [6] * 7
    assert artery.masks[3][5, 6] and vein.masks[3][1, 1]
    assert artery.spacing_mm == (None,) * 7 and not artery.simulated


def test_groups_are_sequences_and_the_notes_say_so(tmp_path) -> None:
    dataset = MusV(str(write_musv(tmp_path, SEQUENCES)), "vein")
    assert dataset().groups == ("001",) * 2 + ("002",) * 3 + ("010",) * 2
    assert dataset.notes()[0].startswith("Subject leakage possible: groups are sequences")


def test_a_table_makes_volunteers_the_groups_and_allows_a_district(tmp_path) -> None:
    root, table = str(write_musv(tmp_path / "set", SEQUENCES)), with_table(tmp_path)
    everything = MusV(root, "vein", subjects=table)
    assert everything().groups == ("anna",) * 5 + ("ben",) * 2
    assert everything.notes() == ("Groups are the volunteers of subjects.csv.",)
    neck = MusV(root, "vein", district="carotid", subjects=table)
    assert neck().case_ids == ("001_000", "001_001")
    assert everything.districts(["001_000", "010_001"]) == ("carotid", "femoral")
    assert MusV(root, "vein").districts(["001_000"]) == ("",)
    groin = MusV(root, "artery", district="femoral", subjects=table)
    assert groin().groups == ("anna",) * 3 + ("ben",) * 2
    assert (everything.name, neck.name, groin.name) == (
        "musv_vein",
        "musv_vein_carotid",
        "musv_artery_femoral",
    )


def test_a_district_needs_the_table(tmp_path) -> None:
    with pytest.raises(InputError, match=r"district: expected all where no table.*pass dataset\.subjects="):
        MusV("x", "vein", district="carotid")
    root, table = (
        str(write_musv(tmp_path / "set", {"001": ("train", 2, (9, 9)), "002": ("train", 2, (9, 9))})),
        (tmp_path / "t.csv"),
    )
    table.write_text("seq,volunteer,district\n001,a,carotid\n002,b,carotid\n")
    with pytest.raises(
        InputError, match="district: expected sequences of district femoral in the table, found none"
    ):
        MusV(root, "vein", district="femoral", subjects=str(table))()


def test_forces_may_be_absent(tmp_path) -> None:
    root = write_musv(tmp_path, SEQUENCES)
    before = MusV(str(root), "vein")().digest()
    for file in (root / "Forces").iterdir():
        file.unlink()
    (root / "Forces").rmdir()
    assert MusV(f"{root}/.", "vein")().digest() == before


def test_a_missing_root_is_one_sentence_with_source_licence_layout_and_override(tmp_path) -> None:
    with pytest.raises(InputError) as refusal:
        MusV(str(tmp_path / "none"), "artery")()
    for part in ("musv_artery", "Mus-V", "CC BY-NC", "Videos/train", "Annotations/<seq>", "dataset.root="):
        assert part in str(refusal.value)


@pytest.mark.parametrize("name, damage, message", DAMAGES, ids=DAMAGE_NAMES)
def test_a_bad_file_is_named(tmp_path, name: str, damage, message: str) -> None:
    root = write_musv(tmp_path, SEQUENCES)
    damage(root / "Videos/train/002/002_001.png", root / "Annotations/002/002_001.png")
    with pytest.raises(InputError, match=rf"002_001\.png: .*{message}"):
        MusV(str(root), "artery")()


@pytest.mark.parametrize("name, damage, message", LONELY, ids=LONELY_NAMES)
def test_what_has_no_partner_is_refused_or_left_out(tmp_path, name: str, damage, message: str) -> None:
    root = write_musv(tmp_path, SEQUENCES)
    damage(root / "Videos/train/002/002_001.png", root / "Annotations/002/002_001.png")
    with pytest.raises(InputError, match=rf"{message} .*002_001\.png\); pass dataset\.unpaired=skip"):
        MusV(str(root), "artery")()
    dataset = MusV(str(root), "artery", unpaired="skip")
    assert dataset().groups == ("001",) * 2 + ("002",) * 2 + ("010",) * 2
    assert dataset.left_out() == 1 and dataset.notes()[-1].startswith("Left out as unpaired: ")


def test_a_sequence_without_annotations_and_annotations_without_a_video_are_listed_together(tmp_path) -> None:
    root = write_musv(tmp_path, SEQUENCES)
    (root / "Videos/valid/001").rename(root / "Videos/valid/003")
    for frame in (root / "Videos/valid/003").iterdir():
        frame.rename(frame.with_name(frame.name.replace("001_", "003_")))
    with pytest.raises(
        InputError, match=r"no mask for 2 images .*no image for 2 masks \(Annotations/001/001_000"
    ):
        MusV(str(root), "vein")()
    dataset = MusV(str(root), "vein", unpaired="skip")
    assert set(dataset().groups) == {"002", "010"} and dataset.left_out() == 4


def test_refuses_masks_without_the_target(tmp_path) -> None:
    root = write_musv(tmp_path, {"001": ("train", 2, (9, 9))}, artery=0)
    assert MusV(str(root), "vein")().masks[0].any()
    with pytest.raises(InputError, match="Annotations: expected masks with a vessel, received 2 empty ones"):
        MusV(str(root), "artery")()


def test_refuses_a_layout_that_is_not_whole(tmp_path) -> None:
    root = write_musv(tmp_path / "a", SEQUENCES)
    (root / "Videos/valid/001").rename(root / "Videos/001")
    with pytest.raises(
        InputError,
        match=r"found no image for 2 masks \(Annotations/001/001_000\.png, Annotations/001/001_001\.png\)",
    ):
        MusV(str(root), "vein")()
    (root / "Videos/valid").rmdir()
    with pytest.raises(InputError, match=r"Videos/valid: expected a folder of sequences, found none"):
        MusV(str(root), "vein")()
    twice = write_musv(tmp_path / "b", SEQUENCES)
    write_musv(twice, {"002": ("valid", 1, (12, 10))})
    with pytest.raises(InputError, match=r"002: expected a sequence in one part, found it in .*train"):
        MusV(str(twice), "vein")()
    alone = write_musv(tmp_path / "c", SEQUENCES)
    (alone / "Videos/train/010/010_001.png").rename(alone / "Videos/train/010/frame1.png")
    with pytest.raises(InputError, match=r"frame1\.png: expected a name 010_<number>, received 'frame1'"):
        MusV(str(alone), "vein")()
    with pytest.raises(InputError, match="Videos: expected sequences in train and valid, found none"):
        MusV(str(write_musv(tmp_path / "d", {})), "vein")()


def test_refuses_settings() -> None:
    with pytest.raises(InputError, match="target: expected one of artery, vein, received 'nerve'"):
        MusV("x", "nerve")
    with pytest.raises(InputError, match="district: expected one of all, carotid, femoral, received 'neck'"):
        MusV("x", "vein", district="neck")


def test_the_substitute_shows_both_vessels_in_both_districts(tmp_path, monkeypatch) -> None:
    draw_sweeps(monkeypatch)
    maker = SimulatedSubstitute(
        subjects=2, recordings=1, frames=2, size_px=48, strength=0.3, cache=str(tmp_path)
    )
    artery, vein = (MusV("none", target, simulate=True, substitute=maker) for target in ("artery", "vein"))
    frames, veins = artery(), vein()
    assert frames.simulated and artery.require_root() is None
    assert frames.groups == ("volunteer_01",) * 4 + ("volunteer_02",) * 4
    assert frames.case_ids[:4] == ("001_000", "001_001", "002_000", "002_001")
    for image, other, one, two in zip(frames.images, veins.images, frames.masks, veins.masks, strict=True):
        np.testing.assert_array_equal(image, other)
        assert one[8:12, 4:7].all() and one.sum() == 12 and two[2:5, 3:9].all() and two.sum() == 18
    assert {"artery": vessel_pair.ARTERY, "vein": vessel_pair.VEIN} == LABELS
    # No table is needed to know the district of what is simulated.
    groin = MusV("none", "artery", district="femoral", simulate=True, substitute=maker)()
    assert groin.case_ids == ("002_000", "002_001", "004_000", "004_001")
    np.testing.assert_array_equal(groin.images[0], frames.images[2])
    assert artery.notes()[0].startswith("Simulated: no image of Mus-V was used")
