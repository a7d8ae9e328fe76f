"""A data set's page of numbers is right where everything is known, and a near-duplicate in another group is found."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from drawn_vessels import drawn_frames

from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split_set import SplitSet
from experiments.studies.inspect_dataset import study as inspect_dataset
from models.labelled_frames import LabelledFrames


@dataclasses.dataclass(frozen=True)
class Known:
    """A data set of given frames, which leaves a table of what it left out."""

    frames: LabelledFrames
    name: str = "known"

    def __call__(self) -> LabelledFrames:
        return self.frames

    def notes(self) -> tuple[str, ...]:
        return ("Groups are drawn.",)

    def report(self) -> dict[str, pd.DataFrame]:
        return {"pruned": pd.DataFrame({"case": ["x"]})}


def looked_at(tmp_path: Path, frames: LabelledFrames, split: GroupSplits | None = None) -> Outcome:
    return inspect_dataset.run(
        dataset=Known(frames),
        split=split or GroupSplits(3),
        duplicate_correlation=0.9,
        worst_pairs=3,
        sheet_images=8,
        seed=0,
        workspace=tmp_path,
        progress=Silent(),
    )


def noise_frames(count: int = 12, per_group: int = 2) -> LabelledFrames:
    """Frames that have nothing in common: large blocks of random grey."""
    frames = drawn_frames(count, size=(48, 48), per_group=per_group)
    rng = np.random.default_rng(1)
    blocks = [np.kron(rng.integers(0, 255, (8, 8)), np.ones((6, 6))).astype(np.uint8) for _ in range(count)]
    return dataclasses.replace(frames, images=tuple(blocks), simulated=False)


def planted(frames: LabelledFrames, place: int, source: int) -> LabelledFrames:
    """The picture of ``source`` once more at ``place``, a little darker and wider."""
    images, masks = list(frames.images), list(frames.masks)
    images[place] = np.pad((images[source] * 0.8).astype(np.uint8), ((0, 0), (0, 4)))
    masks[place] = np.pad(masks[place], ((0, 0), (0, 4)))
    return dataclasses.replace(frames, images=tuple(images), masks=tuple(masks))


def test_counts_of_known_frames(tmp_path) -> None:
    frames = noise_frames()
    masks = [np.zeros((48, 48), bool) for _ in range(12)]
    for index in range(2, 12):
        masks[index][4:16, 4:28] = True  # 288 of 2304 pixels: an eighth
    masks[2][8:10, 8:10] = False  # a hole
    masks[3][30:34, 30:34] = True  # a second component
    masks[4][0:16, 4:28] = True  # up to the edge
    spacing = ((0.5, 0.25),) * 11 + (None,)
    frames = dataclasses.replace(frames, masks=tuple(masks), spacing_mm=spacing)
    outcome = looked_at(tmp_path, frames)
    expected = {
        "images": 12,
        "images_with_vessel": 10,
        "image_sizes": 1,
        "spacing_known": 11,
        "groups": 6,
        "group_size_min": 2,
        "group_size_median": 2,
        "group_size_max": 2,
        "vessel_share_median": 0.125,
        "with_holes": 1,
        "several_components": 1,
        "touching_edge": 1,
        "near_duplicates_across_groups": 0,
        "near_duplicates_leaking": 0,
    }
    assert {name: outcome.metrics[name] for name in expected} == pytest.approx(expected)
    cases = outcome.cases.set_index("case_id")
    assert cases.loc["case02", ["vessel_px", "holes", "components"]].tolist() == [284, 1, 1]
    assert cases.loc["case05", "vessel_mm2"] == pytest.approx(288 * 0.125)
    assert cases.loc["case11", ["vertical_mm", "vessel_mm2"]].isna().all()
    assert list(outcome.tables) == ["known", "image sizes", "most alike across groups"]
    assert "Odd masks: 1 masks of several components, 1 masks with holes" in outcome.findings[2]
    assert outcome.findings[-1] == "Groups are drawn."
    assert outcome.inputs[0].digest == frames.digest()


def test_a_near_duplicate_in_another_group_is_found_and_named(tmp_path) -> None:
    frames = planted(noise_frames(), place=9, source=0)
    outcome = looked_at(tmp_path, frames)
    assert outcome.metrics["near_duplicates_across_groups"] == 1
    assert outcome.metrics["images_with_near_duplicate_elsewhere"] == 2
    assert outcome.metrics["near_duplicates_leaking"] == 1
    worst = outcome.tables["most alike across groups"]
    assert set(worst.iloc[0][["case_id", "closest_case"]]) == {"case00", "case09"}
    assert set(worst.iloc[0][["group", "closest_group"]]) == {"sweep0", "sweep4"}
    assert worst["closest_correlation"].iloc[0] > 0.95 > 0.9 > worst["closest_correlation"].iloc[1]
    assert len(worst) == 3
    assert "1 pairs, 1 of them with one seen in training and the other scored" in outcome.findings[1]


def test_a_near_duplicate_in_its_own_group_is_no_leak(tmp_path) -> None:
    outcome = looked_at(tmp_path, planted(noise_frames(), place=1, source=0))
    assert outcome.metrics["near_duplicates_across_groups"] == 0


def test_near_duplicates_that_are_never_apart_do_not_leak(tmp_path) -> None:
    frames = planted(noise_frames(24), place=3, source=0)
    apart = GroupSplits(3, test_groups=["sweep0"])
    together = GroupSplits(3, test_groups=["sweep0", "sweep1"])
    assert looked_at(tmp_path, frames, apart).metrics["near_duplicates_leaking"] == 1
    assert looked_at(tmp_path, frames, together).metrics["near_duplicates_leaking"] == 0
    assert looked_at(tmp_path, frames, together).metrics["near_duplicates_across_groups"] == 1


def test_leaves_the_split_and_what_was_left_out(tmp_path) -> None:
    frames = noise_frames()
    outcome = looked_at(tmp_path, frames)
    splits = SplitSet.read(tmp_path / "splits.json")
    assert splits == GroupSplits(3)(frames)
    fold_of = dict(zip(outcome.cases["case_id"], outcome.cases["fold"], strict=True))
    assert all(fold_of[case] == split.fold for split in splits for case in split.test)
    assert (tmp_path / "pruned.csv").read_text() == "case\nx\n"


def test_a_set_that_cannot_be_divided_is_inspected_all_the_same(tmp_path) -> None:
    outcome = looked_at(tmp_path, noise_frames(4, per_group=2))
    assert "near_duplicates_leaking" not in outcome.metrics and outcome.metrics["groups"] == 2
    assert "It can't be divided as split= says: folds: expected at least 3 groups" in outcome.findings[-1]
    assert not (tmp_path / "splits.json").exists()
    assert set(outcome.cases["fold"]) == {-1}


def test_simulated_frames_are_called_so(tmp_path) -> None:
    outcome = looked_at(tmp_path, drawn_frames(12))
    assert next(iter(outcome.tables)) == "known (simulated)"
    assert outcome.findings[0].startswith("known (simulated): 12 images in 4 groups")
    assert outcome.tags == {"dataset": "known", "simulated": "true"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"duplicate_correlation": 1.5}, r"duplicate_correlation: expected above 0 to 1, received 1\.5"),
        ({"worst_pairs": 0}, "worst_pairs: expected a whole number of at least 1, received 0"),
        ({"sheet_images": True}, "sheet_images: expected a whole number of at least 1, received True"),
    ],
)
def test_refuses_settings(changes: dict[str, object], message: str) -> None:
    settings = {
        "dataset": Known(noise_frames()),
        "duplicate_correlation": 0.9,
        "worst_pairs": 3,
        "sheet_images": 8,
    }
    inspect_dataset.check(**settings)
    with pytest.raises(InputError, match=message):
        inspect_dataset.check(**{**settings, **changes})


def test_refuses_a_folder_that_is_not_there(tmp_path) -> None:
    from experiments.datasets.usgra import Usgra

    with pytest.raises(InputError, match=r"found no folder .*none; pass dataset\.root="):
        inspect_dataset.check(
            dataset=Usgra(str(tmp_path / "none")), duplicate_correlation=0.9, worst_pairs=3, sheet_images=8
        )
