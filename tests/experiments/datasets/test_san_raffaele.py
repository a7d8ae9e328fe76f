from pathlib import Path

import numpy as np
import pytest
from dataset_layouts import grey, size_of, write_san_raffaele
from drawn_sweeps import draw_sweeps

from experiments.datasets.protocol import write_report
from experiments.datasets.san_raffaele import SanRaffaele
from experiments.datasets.simulated import SimulatedSubstitute
from experiments.errors import InputError

ROWS = [
    ("v1", "ann", "", 14),
    ("v2", "ann", "yes", 4),
    ("v3", "ben", "", 4),
    ("v4", "cleo", "", 5),
    ("v5", "dan", "1", 3),
    ("v6", "", "no", 6),
]
SUBSETS = ("single_session", "full", "pruned", "full_subsampled")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_san_raffaele(tmp_path_factory.mktemp("san_raffaele"), ROWS)


def configured(root: Path, subset: str, **changes: object) -> SanRaffaele:
    settings = {"blocks": 3, "gap_frames": 1, "test_subjects": ["cleo"]}
    return SanRaffaele(str(root), subset, **{**settings, **changes})  # type: ignore[arg-type]


def pool_of(dataset: SanRaffaele) -> list[str]:
    frames, tested = dataset(), dataset.test_groups()
    return [case for case, group in zip(frames.case_ids, frames.groups, strict=True) if group not in tested]


def test_full_is_everything_by_subject_else_session(root: Path) -> None:
    frames = configured(root, "full")()
    assert len(frames) == 36 and not frames.simulated
    assert {group: frames.groups.count(group) for group in set(frames.groups)} == {
        "ann": 18,
        "ben": 4,
        "cleo": 5,
        "dan": 3,
        "v6": 6,
    }


def test_single_session_is_the_largest_in_blocks_and_says_so(root: Path) -> None:
    dataset = configured(root, "single_session")
    frames = dataset()
    assert list(dict.fromkeys(frames.groups)) == [
        "v1_block_0",
        "v1_block_1",
        "v1_block_2",
        "cleo",
    ]
    assert len(pool_of(dataset)) == 12
    assert any("contiguous blocks of one session" in note for note in dataset.notes())
    assert set(configured(root, "single_session", session="v6")().groups) == {
        "v6_block_0",
        "v6_block_1",
        "v6_block_2",
        "cleo",
    }


def test_pruned_leaves_out_what_is_listed_and_writes_why(root: Path, tmp_path) -> None:
    dataset = configured(root, "pruned")
    assert {case.split("_")[0] for case in pool_of(dataset)} == {"v1", "v3", "v6"}
    written = write_report(dataset, tmp_path)
    assert [path.name for path in written] == ["pruned.csv", "sessions.csv"]
    lines = (tmp_path / "pruned.csv").read_text().splitlines()
    assert lines[0] == "case,session,rule,value,limit,measured"
    assert len(lines) == 8 and lines[1].startswith("v2_frame_0,v2,excluded in sessions.csv,excluded,")
    sessions = dataset.report()["sessions"].set_index("session")
    assert list(sessions["train_frames"]) == [14, 0, 4, 0, 0, 6]
    assert list(sessions["test_frames"]) == [0, 0, 0, 5, 0, 0]
    assert any(note == "Frames left out by the list of the excluded: 7." for note in dataset.notes())


def test_pruning_by_quality_finds_planted_frames_and_the_file_says_why(tmp_path) -> None:
    root = write_san_raffaele(tmp_path / "set", ROWS)
    black = root / "v3/images/frame_2.png"
    grey(black, np.zeros(size_of(black)))
    dataset = configured(root, "pruned", prune_by="quality")
    assert set(pool_of(configured(root, "full"))) - set(pool_of(dataset)) == {"v3_frame_2"}
    write_report(dataset, tmp_path)
    rows = [line.split(",") for line in (tmp_path / "pruned.csv").read_text().splitlines()[1:]]
    assert {row[0] for row in rows} == {"v3_frame_2"}
    assert "brightness unlike the rest" in {row[2] for row in rows}
    assert all(abs(float(row[3])) > 3.5 and float(row[4]) == 3.5 for row in rows)
    assert any(note == "Frames left out by image quality: 1." for note in dataset.notes())


def test_full_is_subsampled_to_the_size_of_the_other_two(root: Path) -> None:
    everything = set(pool_of(configured(root, "full")))
    for other in ("pruned", "single_session"):
        dataset = configured(root, "full_subsampled", subsample_to=other)
        drawn = pool_of(dataset)
        assert len(drawn) == len(pool_of(configured(root, other))) and set(drawn) < everything
        assert dataset.name == f"san_raffaele_full_as_{other}"
    assert drawn != pool_of(
        configured(root, "full_subsampled", subsample_to="single_session", subsample_seed=1)
    )


@pytest.mark.parametrize("drawn", [{}, {"test_subjects": None, "test_seed": 4}])
def test_all_configurations_are_tested_on_the_same_frames(root: Path, drawn: dict) -> None:
    tests = []
    for subset in SUBSETS:
        dataset = configured(root, subset, **drawn)
        frames, tested = dataset(), dataset.test_groups()
        test = frames.subset([i for i, group in enumerate(frames.groups) if group in tested])
        assert len(test) > 0 and not {"ann", "v1"} & set(tested)
        assert not set(test.case_ids) & set(pool_of(dataset))
        tests.append((tested, test.case_ids, test.digest()))
    assert tests == [tests[0]] * 4
    assert len({configured(root, subset, **drawn)().digest() for subset in SUBSETS}) == 4


def test_images_are_read_once_for_all_configurations(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    configured(root, "full")()
    monkeypatch.setattr(
        "experiments.datasets.images.image_files.read_grey", lambda *_: pytest.fail("read again")
    )
    assert configured(root, "single_session", blocks=2)() is configured(root, "single_session", blocks=2)()


def test_a_missing_root_is_one_sentence_with_source_layout_and_override(tmp_path) -> None:
    with pytest.raises(InputError) as refusal:
        SanRaffaele(str(tmp_path / "none"))()
    for part in ("san_raffaele", "private", "<session>/images", "sessions.csv", "dataset.root="):
        assert part in str(refusal.value)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"subset": "half"},
            "subset: expected one of single_session, full, pruned, full_subsampled, received 'half'",
        ),
        ({"prune_by": "taste"}, "prune_by: expected one of list, quality"),
        ({"subsample_to": "full"}, "subsample_to: expected one of pruned, single_session"),
        ({"test_share": 1.0}, "test_share: expected above 0 and below 1"),
        ({"test_subjects": []}, "test_subjects null or some"),
        ({"quality_limit": 0}, "quality_limit: expected a number above 0"),
        ({"blocks": 1}, "blocks: expected a whole number of at least 2"),
        ({"gap_frames": -1}, "gap_frames: expected a whole number of at least 0"),
    ],
)
def test_refuses_settings(settings: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SanRaffaele("x", **settings)


def test_the_substitute_goes_through_the_same_configurations(tmp_path, monkeypatch) -> None:
    draw_sweeps(monkeypatch)
    maker = SimulatedSubstitute(subjects=4, recordings=2, frames=2, size_px=32, cache=str(tmp_path))
    sets = [
        SanRaffaele("none", subset, blocks=2, gap_frames=1, simulate=True, substitute=maker)
        for subset in SUBSETS
    ]
    for dataset in sets:
        assert dataset().simulated and dataset.require_root() is None
        assert dataset.notes()[0].startswith("Simulated: no image of San Raffaele was used")
    assert len({dataset.test_groups() for dataset in sets}) == 1
    assert len(pool_of(sets[0])) == 7 and len(pool_of(sets[1])) > len(pool_of(sets[2])) == len(
        pool_of(sets[3])
    )
