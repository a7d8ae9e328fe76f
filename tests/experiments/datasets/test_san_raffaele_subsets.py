import numpy as np
import pytest

from experiments.datasets import san_raffaele_subsets as subsets
from experiments.datasets.san_raffaele_sessions import Session
from experiments.errors import InputError


def session(
    name: str, group: str, count: int, reasons: dict[int, str] | None = None, level: int = 80
) -> Session:
    rng = np.random.default_rng([len(name), count, level])
    images = tuple(rng.integers(level - 20, level + 20, (20, 22)).astype(np.uint8) for _ in range(count))
    cases = tuple(f"{name}_{index}" for index in range(count))
    masks = (np.ones((20, 22), bool),) * count
    return Session(name, group, "", "", reasons or {}, cases, images, masks, None)


SESSIONS = (session("s1", "a", 9), session("s2", "b", 20), session("s3", "c", 6), session("s4", "d", 5))


def test_the_largest_session_stands_alone_unless_one_is_named() -> None:
    assert subsets.lone_session(SESSIONS, None).name == "s2"
    assert subsets.lone_session(SESSIONS, "s3").name == "s3"
    out = session("s5", "e", 50, dict.fromkeys(range(50), "excluded"))
    assert subsets.lone_session((*SESSIONS, out), None).name == "s2"
    with pytest.raises(
        InputError, match=r"session: expected one of the data set's sessions \(s1, .*received 's9'"
    ):
        subsets.lone_session(SESSIONS, "s9")


def test_test_subjects_are_drawn_by_seed_and_never_hold_the_lone_session() -> None:
    drawn = {subsets.test_groups(SESSIONS, SESSIONS[1], None, 0.5, seed) for seed in range(30)}
    assert drawn == {("a", "c"), ("a", "d"), ("c", "d")}
    assert subsets.test_groups(SESSIONS, SESSIONS[1], None, 0.01, 3) == subsets.test_groups(
        SESSIONS, SESSIONS[1], None, 0.01, 3
    )
    # A share of nearly all still leaves one to train with.
    assert len(subsets.test_groups(SESSIONS, SESSIONS[1], None, 0.99, 0)) == 2
    assert subsets.test_groups(SESSIONS, SESSIONS[1], ["d", "a"], 0.5, 0) == ("a", "d")


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        (["z"], "test_subjects: expected subjects of the data set, received 'z'"),
        (["b"], "none with the session that stands alone, received 'b' of session 's2'"),
        (["a", "c", "d"], "expected subjects left to train with, received all of them"),
    ],
)
def test_refuses_test_subjects(wanted: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        subsets.test_groups(SESSIONS, SESSIONS[1], wanted, 0.5, 0)
    with pytest.raises(InputError, match=r"expected at least 3 subjects.*received 2"):
        subsets.test_groups(SESSIONS[:2], SESSIONS[1], None, 0.5, 0)


def test_blocks_are_contiguous_with_the_gap_between_them() -> None:
    chosen = subsets.in_blocks(SESSIONS[1], blocks=3, gap_frames=2)
    places = {}
    for frame in chosen.frames:
        places.setdefault(frame.group, []).append(frame.place)
    assert places == {
        "s2_block_0": [0, 1, 2, 3, 4, 5],
        "s2_block_1": [8, 9, 10, 11, 12],
        "s2_block_2": [15, 16, 17, 18, 19],
    }
    assert [row["case"] for row in chosen.left_out] == ["s2_6", "s2_7", "s2_13", "s2_14"]
    assert {row["rule"] for row in chosen.left_out} == {"gap between blocks"}
    whole = subsets.in_blocks(SESSIONS[1], blocks=4, gap_frames=0)
    assert len(whole.frames) == 20 and whole.left_out == ()
    with pytest.raises(
        InputError, match=r"blocks: .*'s3' of 6 frames has room for with gap_frames=2, received 3"
    ):
        subsets.in_blocks(SESSIONS[2], blocks=3, gap_frames=2)


def test_what_is_listed_is_left_out_with_its_reason() -> None:
    pool = subsets.frames_of([session("s1", "a", 3, {1: "excluded in excluded.csv: blurred"}), SESSIONS[3]])
    chosen = subsets.without_listed(pool)
    assert [frame.case for frame in chosen.frames] == ["s1_0", "s1_2", *(f"s4_{index}" for index in range(5))]
    assert chosen.left_out == (
        {
            "case": "s1_1",
            "session": "s1",
            "rule": "excluded in excluded.csv: blurred",
            "value": "excluded",
            "limit": "",
        },
    )
    with pytest.raises(
        InputError, match=r"subset: .*found none outside the test; pass dataset\.prune_by=quality"
    ):
        subsets.without_listed(subsets.frames_of(SESSIONS))


def test_outliers_of_quality_are_left_out_with_score_and_limit() -> None:
    pool = subsets.frames_of([*SESSIONS, session("odd", "e", 2, level=180)])
    chosen = subsets.without_outliers(pool, 3.5)
    assert {row["case"] for row in chosen.left_out} == {"odd_0", "odd_1"}
    assert len(chosen.frames) == 40 and not any(frame.session.name == "odd" for frame in chosen.frames)
    row = next(row for row in chosen.left_out if row["rule"] == "brightness unlike the rest")
    assert (
        row["limit"] == 3.5 and row["value"] > 3.5 and row["measured"] == pytest.approx(np.log(180), abs=0.02)
    )


def test_a_sample_has_its_size_keeps_order_and_goes_through_all_sessions() -> None:
    pool = subsets.frames_of(SESSIONS)
    chosen = subsets.sampled(pool, 16, 0).frames
    cases = [frame.case for frame in pool]
    places = [cases.index(frame.case) for frame in chosen]
    assert len(set(places)) == 16 and places == sorted(places)
    assert chosen == subsets.sampled(pool, 16, 0).frames != subsets.sampled(pool, 16, 1).frames
    drawn = np.zeros(40)
    for seed in range(400):
        drawn[[cases.index(frame.case) for frame in subsets.sampled(pool, 10, seed).frames]] += 1
    # Each of 40 has one chance in four: 100 of 400, deviation 8.7.
    assert abs(drawn - 100).max() < 4.5 * 8.7
    assert subsets.sampled(pool, 99, 0).frames == pool
