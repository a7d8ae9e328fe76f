"""Study ``inspect_dataset``: what a data set holds, whether its groups keep alike images together, and how it looks."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments.datasets.images.mask_shape import mask_shape
from experiments.datasets.images.near_duplicates import CrossGroupDuplicates, near_duplicates_across_groups
from experiments.datasets.protocol import (
    DataSet,
    input_data,
    label_of,
    name_of,
    notes_of,
    outside_groups,
    require_root,
    write_report,
)
from experiments.errors import InputError, require_count
from experiments.outcome import Outcome, Progress
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split_set import SplitSet
from experiments.studies.inspect_dataset.report import (
    contact_sheet,
    describe,
    metrics,
    overview,
    pair_table,
    size_table,
)
from models.labelled_frames import LabelledFrames

if TYPE_CHECKING:
    import pandas as pd

SEEN = ("train", "validation")


def check(*, dataset: DataSet, duplicate_correlation: float, worst_pairs: int, sheet_images: int) -> None:
    """Raise InputError for a data set that is not there or settings out of range."""
    require_root(dataset)
    if not 0 < duplicate_correlation <= 1:
        raise InputError(f"duplicate_correlation: expected above 0 to 1, received {duplicate_correlation}")
    for name, count in (("worst_pairs", worst_pairs), ("sheet_images", sheet_images)):
        require_count(name, count)


def run(
    *,
    dataset: DataSet,
    split: GroupSplits,
    duplicate_correlation: float,
    worst_pairs: int,
    sheet_images: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Measure every image and pair of images; leaves ``splits.json``, where the data set can be divided so,
    and the tables of what the data set left out, where it has any.

    Near-duplicates are images whose thumbnails correlate above ``duplicate_correlation`` (see ``similarity_blocks``).
    Raises InputError for a data set that can't be read; one that can't be divided as ``split`` says is inspected all
    the same, and the outcome says so.
    """
    progress.note(f"reading {name_of(dataset)}")
    frames = dataset()
    progress.note(f"comparing {len(frames)} images")
    alike = near_duplicates_across_groups(frames.images, frames.groups, duplicate_correlation)
    notes = list(notes_of(dataset))
    splits = None
    try:
        splits = split(frames, **outside_groups(dataset))
        splits.write(workspace / "splits.json")
    except InputError as refusal:
        notes.append(f"It can't be divided as split= says: {refusal}.")
    leaks = None if splits is None else leaking(frames, splits, alike)
    cases = case_table(frames, alike, splits, progress)
    write_report(dataset, workspace)
    label = label_of(dataset, frames)
    numbers = metrics(cases, alike, leaks)
    return Outcome(
        metrics=numbers,
        cases=cases,
        tables={
            label: overview(cases, numbers),
            "image sizes": size_table(cases),
            "most alike across groups": pair_table(cases, worst_pairs),
        },
        figures={"contact_sheet": contact_sheet(frames, label, sheet_images, seed)},
        findings=(*describe(label, numbers, duplicate_correlation), *notes),
        tags={"dataset": name_of(dataset), "simulated": str(frames.simulated).lower()},
        inputs=(input_data(dataset, frames),),
    )


def leaking(frames: LabelledFrames, splits: SplitSet, alike: CrossGroupDuplicates) -> int:
    """How many pairs of near-duplicates have one seen in training and the other scored, in any fold."""
    number_of = {case: number for number, case in enumerate(frames.case_ids)}
    first, second = alike.pairs.T
    leaks = np.zeros(len(first), dtype=bool)
    for split in splits:
        seen = np.zeros(len(frames), dtype=bool)
        for case, side in split.sides():
            seen[number_of[case]] = side in SEEN
        leaks |= seen[first] != seen[second]
    return int(leaks.sum())


def case_table(
    frames: LabelledFrames, alike: CrossGroupDuplicates, splits: SplitSet | None, progress: Progress
) -> pd.DataFrame:
    """A row for each case: size, pixel size, mask, the most alike image of another group, the fold that tests it.

    ``fold`` is -1 for a case that no fold tests.
    """
    import pandas as pd

    tested = {} if splits is None else {case: one.fold for one in splits for case in one.test}
    rows = []
    for number in progress.track(range(len(frames)), "measuring masks", len(frames)):
        shape = mask_shape(frames.masks[number])
        height, width = frames.images[number].shape
        vertical, horizontal = frames.spacing_mm[number] or (np.nan, np.nan)
        closest = alike.closest[number]
        rows.append(
            {
                "case_id": frames.case_ids[number],
                "group": frames.groups[number],
                "fold": tested.get(frames.case_ids[number], -1),
                "height_px": height,
                "width_px": width,
                "vertical_mm": vertical,
                "horizontal_mm": horizontal,
                "vessel_px": shape.area_px,
                "vessel_mm2": shape.area_px * vertical * horizontal,
                "vessel_share": shape.area_px / (height * width),
                "components": shape.components,
                "holes": shape.holes,
                "touches_edge": shape.touches_edge,
                "closest_case": "" if closest < 0 else frames.case_ids[closest],
                "closest_group": "" if closest < 0 else frames.groups[closest],
                "closest_correlation": alike.similarity[number],
            }
        )
    return pd.DataFrame(rows)
