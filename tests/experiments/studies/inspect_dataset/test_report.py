import dataclasses

import numpy as np
import pandas as pd
from drawn_vessels import drawn_frames

from experiments.studies.inspect_dataset.report import contact_sheet, pair_table, sample_evenly, size_table


def test_every_group_is_shown_before_one_is_shown_twice() -> None:
    groups = ("a",) * 20 + ("b",) * 2 + ("c",)
    for seed in range(5):
        assert [groups[index] for index in sample_evenly(groups, 3, seed)] == ["a", "b", "c"]
        assert [groups[index] for index in sample_evenly(groups, 7, seed)] == ["a"] * 4 + ["b"] * 2 + ["c"]
    assert len(set(sample_evenly(groups, 100, 0))) == 23
    assert sample_evenly(groups, 7, 0) == sample_evenly(groups, 7, 0) != sample_evenly(groups, 7, 1)


def test_the_sheet_outlines_each_mask_on_its_image() -> None:
    frames = drawn_frames(5, size=(40, 48), per_group=1)
    mask = np.zeros((800, 400), bool)
    mask[200:600, 100:300] = True
    frames = dataclasses.replace(
        frames,
        images=(*frames.images[:4], np.full((800, 400), 90, np.uint8)),
        masks=(np.zeros((40, 48), bool), *frames.masks[1:4], mask),
    )
    figure = contact_sheet(frames, "drawn", 5, seed=0)
    shown = [axes for axes in figure.axes if axes.images]
    titles = [axes.get_title() for axes in shown]
    assert titles[0] == "case00\nsweep0, no vessel" and titles[4] == "case04\nsweep4, vessel 25.0 %"
    assert [len(axes.collections) for axes in shown] == [0, 1, 1, 1, 1]
    # The picture is halved, and so is the outline: half a pixel outside the mask, in pixels of the picture.
    picture, (outline,) = shown[4].images[0].get_array(), shown[4].collections
    assert picture.shape == (400, 200)
    corners = outline.get_paths()[0].vertices
    np.testing.assert_allclose(corners.min(axis=0), [49.5, 99.5], atol=0.3)
    np.testing.assert_allclose(corners.max(axis=0), [149.5, 299.5], atol=0.3)
    assert "5 of 5 images" in figure.get_suptitle()


def test_long_names_do_not_run_into_each_other() -> None:
    frames = drawn_frames(1)
    name = "20010203040506" * 4 + "_slice_7"
    figure = contact_sheet(dataclasses.replace(frames, case_ids=(name,)), "drawn", 3, 0)
    shown = figure.axes[0].get_title().splitlines()[0]
    assert len(shown) == 28 and shown.startswith("2001020304…") and shown.endswith("_slice_7")


def test_rare_sizes_are_one_line() -> None:
    sizes = [(100, 200)] * 5 + [(50, 60 + index) for index in range(12)]
    table = size_table(pd.DataFrame(sizes, columns=["height_px", "width_px"]), rows=4)
    assert table["size_px"].iloc[0] == "200 x 100" and table["size_px"].iloc[3] == "10 others"
    assert table["images"].tolist() == [5, 1, 1, 10]


def test_a_pair_is_listed_once() -> None:
    cases = pd.DataFrame(
        {
            "case_id": ["a", "b", "c", "d"],
            "group": ["1", "2", "3", "4"],
            "closest_case": ["b", "a", "a", ""],
            "closest_group": ["2", "1", "1", ""],
            "closest_correlation": [0.8, 0.8, 0.9, np.nan],
        }
    )
    table = pair_table(cases, 5)
    assert table[["case_id", "closest_case"]].to_numpy().tolist() == [["c", "a"], ["a", "b"]]
    assert len(pair_table(cases, 1)) == 1
    assert list(pair_table(cases[cases["case_id"] == "d"], 5).columns) == list(table.columns)
