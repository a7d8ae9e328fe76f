import numpy as np
import pytest
from dataset_layouts import DAMAGE_NAMES, DAMAGES, LONELY, LONELY_NAMES, speckle, write_san_raffaele

from experiments.datasets.san_raffaele_sessions import left_over, read_sessions
from experiments.errors import InputError

ROWS = [("visit b", "ann", "no", 12), ("visit a", "ann", "yes", 3), ("visit c", "", "", 4)]


def test_reads_sessions_with_their_subjects_and_frames_in_order_of_number(tmp_path) -> None:
    sessions = read_sessions(write_san_raffaele(tmp_path, ROWS), None)
    assert [session.name for session in sessions] == ["visit a", "visit b", "visit c"]
    assert [session.group for session in sessions] == ["ann", "ann", "visit c"]
    assert [session.date for session in sessions] == ["2024-01-02", "2024-01-01", "2024-01-03"]
    assert [session.scanner for session in sessions] == ["scanner 1", "scanner 0", "scanner 0"]
    assert sessions[1].cases[2] == "visit b_frame_2" and sessions[1].cases[11] == "visit b_frame_11"
    np.testing.assert_array_equal(sessions[1].images[11], speckle(11, (24, 26)))
    assert sessions[1].masks[0].sum() == 12 and sessions[1].spacing_mm is None


def test_exclusion_by_session_and_by_frame(tmp_path) -> None:
    root = write_san_raffaele(tmp_path, ROWS)
    (root / "excluded.csv").write_text(
        "session,frame,reason\nvisit b,frame_10,no contact\nvisit c,frame_0,\n"
    )
    first, second, third = read_sessions(root, None)
    assert first.excluded and not second.excluded and not third.excluded
    assert first.reasons == dict.fromkeys(range(3), "excluded in sessions.csv")
    assert second.reasons == {10: "excluded in excluded.csv: no contact"}
    assert third.reasons == {0: "excluded in excluded.csv"}


def test_the_pixels_size_where_the_table_has_it(tmp_path) -> None:
    root = write_san_raffaele(tmp_path, ROWS[:2])
    (root / "sessions.csv").write_text(
        "session,subject,date,scanner,excluded,vertical_mm,horizontal_mm\nvisit a,,,,,0.1,0.2\nvisit b,,,,,,\n"
    )
    first, second = read_sessions(root, None)
    assert first.spacing_mm == (0.1, 0.2) and second.spacing_mm is None and second.group == "visit b"


@pytest.mark.parametrize("name, damage, message", DAMAGES, ids=DAMAGE_NAMES)
def test_a_bad_file_is_named(tmp_path, name: str, damage, message: str) -> None:
    root = write_san_raffaele(tmp_path, ROWS)
    damage(root / "visit c/images/frame_2.png", root / "visit c/masks/frame_2.png")
    with pytest.raises(InputError, match=rf"visit c/\w+/frame_2\.png: .*{message}"):
        read_sessions(root, None)


@pytest.mark.parametrize("name, damage, message", LONELY, ids=LONELY_NAMES)
def test_what_has_no_partner_is_refused_or_left_out(tmp_path, name: str, damage, message: str) -> None:
    root = write_san_raffaele(tmp_path, ROWS)
    damage(root / "visit c/images/frame_2.png", root / "visit c/masks/frame_2.png")
    with pytest.raises(
        InputError, match=rf"{message} \(visit c/\w+/frame_2\.png\); pass dataset\.unpaired=skip"
    ):
        read_sessions(root, None)
    # A frame that is left out may stand on the list of the excluded.
    (root / "excluded.csv").write_text("session,frame\nvisit c,frame_2\nvisit c,frame_3\n")
    third = read_sessions(root, None, "skip")[2]
    assert third.cases == ("visit c_frame_0", "visit c_frame_1", "visit c_frame_3")
    assert list(third.reasons) == [2] and left_over(root).unpaired == 1


def test_a_session_without_any_mask_is_left_out_as_a_whole(tmp_path) -> None:
    root = write_san_raffaele(tmp_path, ROWS)
    for file in (root / "visit a/masks").iterdir():
        file.unlink()
    (root / "visit a/masks").rmdir()
    with pytest.raises(InputError, match=r"no mask for 3 images \(visit a/images/frame_0\.png, "):
        read_sessions(root, None)
    assert [one.name for one in read_sessions(root, None, "skip")] == ["visit b", "visit c"]


def test_refuses_masks_that_are_all_empty(tmp_path) -> None:
    with pytest.raises(InputError, match="expected masks with a vessel, received 19 empty ones"):
        read_sessions(write_san_raffaele(tmp_path, ROWS, value=0), None)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("session,subject\nvisit a,x\n", "expected columns session, subject, date, scanner, excluded"),
        ("session,subject,date,scanner,excluded\n", "expected a row for each session, found none"),
        (
            "session,subject,date,scanner,excluded\nvisit a,,,,\nvisit a,,,,\n",
            "expected one row for each session, received 'visit a' twice",
        ),
        (
            "session,subject,date,scanner,excluded\nvisit a,,,,\nvisit b,,,,\n",
            "expected a row for session 'visit c', found none",
        ),
        (
            "session,subject,date,scanner,excluded\nvisit a,,,,\nvisit b,,,,maybe\nvisit c,,,,\n",
            "expected excluded to be 1, yes, true, 0, no, false or empty for session 'visit b', received 'maybe'",
        ),
    ],
)
def test_refuses_a_table_of_sessions(tmp_path, table: str, message: str) -> None:
    root = write_san_raffaele(tmp_path, ROWS)
    (root / "sessions.csv").write_text(table)
    with pytest.raises(InputError, match=rf"sessions\.csv: .*{message}"):
        read_sessions(root, None)


def test_refuses_a_session_or_an_excluded_frame_that_is_not_there(tmp_path) -> None:
    root = write_san_raffaele(tmp_path, ROWS)
    (root / "excluded.csv").write_text("session,frame\nvisit b,frame_99\n")
    with pytest.raises(InputError, match=r"excluded\.csv: .*received 'frame_99' of session 'visit b'"):
        read_sessions(root, None)
    with (root / "sessions.csv").open("a") as file:
        file.write("visit d,x,,,\n")
    with pytest.raises(InputError, match="visit d/images: expected a folder of images, found none"):
        read_sessions(root, None)
