"""Masks next to reference masks: scores drawn by hand, and everything that does not fit."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from experiments.errors import InputError
from experiments.outcome import Silent
from experiments.running.terminal import markdown
from experiments.studies.evaluate.mask_pairs import MaskLabels, MaskPairs, pair_masks, require_spacing
from experiments.studies.evaluate.masks import describe_masks, mask_metrics, mask_rows, mask_table
from models.metrics import masks


def save(path: Path, mask: np.ndarray, full: int = 255) -> None:
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(mask.astype(np.uint8) * full).save(path)


def square(left: int, size: int = 10) -> np.ndarray:
    mask = np.zeros((40, 60), dtype=bool)
    mask[10 : 10 + size, left : left + size] = True
    return mask


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Five references: hit, shifted, not predicted, and two without a vessel, one with a false alarm."""
    truth, given = tmp_path / "truth", tmp_path / "given"
    for name in ("a", "b", "c"):
        save(truth / f"{name}.png", square(20))
    for name in ("d", "e"):
        save(truth / f"{name}.png", square(0, 0))
    save(given / "a.png", square(20), full=1)
    save(given / "b.png", square(24))
    save(given / "d.png", square(5))
    save(given / "e.png", square(0, 0))
    save(given / "z.png", square(5))
    return given, truth


def table(given: Path, truth: Path, spacing_mm: object = None) -> tuple[pd.DataFrame, MaskPairs]:
    pairs = pair_masks(given, truth, spacing_mm)
    return pd.DataFrame(list(mask_rows(pairs, Silent()))), pairs


def test_scores_are_those_worked_out_by_hand(folders: tuple[Path, Path]) -> None:
    cases, pairs = table(*folders, spacing_mm=[0.5, 0.25])
    rows = cases.set_index("case_id")
    assert rows.loc["a", "dsc"] == 1.0
    assert rows.loc["a", "hd95_mm"] == 0.0
    # Ten columns of which six are common.
    assert rows.loc["b", "dsc"] == pytest.approx(0.6)
    assert rows.loc["b", "hd95_mm"] == masks.hd95_mm(square(24), square(20), (0.5, 0.25)) == 1.0
    assert rows.loc["b", "hd95_surfel_mm"] == masks.hd95_surfel_mm(square(24), square(20), (0.5, 0.25))
    assert rows.loc["c", "dsc"] == 0.0
    assert rows.loc["c", "hd95_mm"] == pytest.approx(math.hypot(40 * 0.5, 60 * 0.25))
    assert rows.loc["c", "missing"] and rows.loc["c", "missed"] == 1.0
    assert rows.loc["d", "false_alarm"] == 1.0
    assert rows.loc["e", "false_alarm"] == 0.0
    assert math.isnan(rows.loc["e", "dsc"])
    found = mask_metrics(cases)
    assert found["dsc_mean"] == pytest.approx(1.6 / 3)
    assert found["missed_rate"] == pytest.approx(1 / 3)
    assert found["false_alarm_rate"] == 0.5
    assert (found["cases"], found["cases_missing"]) == (5, 1)
    assert list(mask_table(found)["dsc_mean"]) == [found["dsc_mean"]]
    assert "| 5 | 1 |" in markdown({"masks": mask_table(found)})
    said = " ".join(describe_masks(cases, found, pairs))
    assert "3 masks with a vessel: mean DSC 0.533" in said
    assert "1 of 5 predictions are missing and count as misses (first: c)" in said
    assert "1 predictions have no reference and are not scored (first: z)" in said
    assert "2 masks without a vessel: 1 false alarms" in said


def test_without_a_spacing_distances_are_in_pixels(folders: tuple[Path, Path]) -> None:
    cases, pairs = table(*folders)
    assert "hd95_mm" not in cases
    assert cases.set_index("case_id").loc["b", "hd95_px"] == 4.0
    assert "spacing_mm=" in describe_masks(cases, mask_metrics(cases), pairs)[-1]


def test_a_missing_prediction_of_nothing_is_no_right_result(folders: tuple[Path, Path]) -> None:
    given, truth = folders
    (given / "e.png").unlink()
    cases, _ = table(given, truth)
    row = cases.set_index("case_id").loc["e"]
    assert row["missing"]
    assert math.isnan(row["false_alarm"])
    assert mask_metrics(cases)["false_alarm_rate"] == 1.0


def test_one_file_goes_with_one_file(folders: tuple[Path, Path]) -> None:
    given, truth = folders
    cases, _ = table(given / "z.png", truth / "a.png")
    assert cases["dsc"].tolist() == [0.0]
    with pytest.raises(InputError, match="prediction: expected a file, as reference is, received a folder"):
        pair_masks(given, truth / "a.png", None)
    with pytest.raises(InputError, match="prediction: expected a folder, as reference is, received a file"):
        pair_masks(given / "a.png", truth, None)


def test_what_does_not_fit_is_named(folders: tuple[Path, Path], tmp_path: Path) -> None:
    given, truth = folders
    save(given / "b.png", np.zeros((30, 60), dtype=bool))
    with pytest.raises(
        InputError, match=r"given/b.png: expected the size of its reference .*60x40, received 60x30"
    ):
        table(given, truth)
    save(given / "b.png", square(20), full=7)
    with pytest.raises(InputError, match=r"b.png: expected labels 0, 1, 255, received 7"):
        table(given, truth)
    (given / "b.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"b.png: expected an image"):
        table(given, truth)
    save(tmp_path / "others" / "q.png", square(3))
    with pytest.raises(InputError, match=r"prediction: expected masks named as those in .*\(a, ...\)"):
        pair_masks(tmp_path / "others", truth, None)


def labelled(folder: Path, name: str, left: int, others: int = 1, vessel: int = 2) -> None:
    """A mask with another structure next to the vessel."""
    labels = square(left).astype(np.uint8) * vessel
    labels[30:35, 5:50] = others
    folder.mkdir(exist_ok=True)
    Image.fromarray(labels).save(folder / f"{name}.png")


def scored(given: Path, truth: Path, *labels: object) -> pd.DataFrame:
    pairs = pair_masks(given, truth, None, MaskLabels.of(*labels))
    return pd.DataFrame(list(mask_rows(pairs, Silent()))).set_index("case_id")


def test_one_label_of_several_is_scored(tmp_path: Path) -> None:
    given, truth = tmp_path / "given", tmp_path / "truth"
    for name, left in (("a", 20), ("b", 24)):
        labelled(truth, name, 20)
        labelled(given, name, left)
    with pytest.raises(InputError, match=r"expected labels 0, 1, 255, received 2; pass label=<the vessel's>"):
        scored(given, truth, None, None, None)
    cases = scored(given, truth, 2, None, None)
    assert cases["dsc"].tolist() == pytest.approx([1.0, 0.6])
    assert scored(given, truth, 1, None, None)["dsc"].tolist() == [1.0, 1.0]
    assert scored(given, truth, [1, 2], None, None).loc["b", "dsc"] == pytest.approx(1 - 80 / (2 * 325))


def test_predictions_may_have_another_label_and_it_must_be_said(tmp_path: Path) -> None:
    given, truth = tmp_path / "given", tmp_path / "truth"
    labelled(truth, "a", 20)
    save(given / "a.png", square(20))
    with pytest.raises(
        InputError, match=r"prediction: expected masks with the label 2 .*received 0, 255; pass predic"
    ):
        scored(given, truth, 2, None, None)
    assert scored(given, truth, 2, 255, None)["dsc"].tolist() == [1.0]
    save(given / "a.png", square(20), full=1)
    with pytest.raises(InputError, match=r"prediction: expected masks with the label 2 .*received 0, 1"):
        scored(given, truth, 2, None, None)
    with pytest.raises(
        InputError, match=r"label: expected one that the reference masks hold \(0, 1, 2\), received 7"
    ):
        scored(given, truth, 7, None, None)


def test_what_nobody_labelled_is_scored_neither_way(tmp_path: Path) -> None:
    given, truth = tmp_path / "given", tmp_path / "truth"
    labelled(truth, "a", 20, others=9)
    save(given / "a.png", square(20) | (np.arange(40)[:, None] >= 30), full=2)
    assert scored(given, truth, 2, None, None).loc["a", "dsc"] == pytest.approx(2 * 100 / (100 + 700))
    # Of the 600 pixels too many, 5 rows of 45 are not labelled.
    assert scored(given, truth, 2, None, 9).loc["a", "dsc"] == pytest.approx(2 * 100 / (100 + 700 - 225))


def test_labels_that_are_none_are_refused() -> None:
    for wrong in (0, -1, 1.5, True, "a", [], [1, "b"]):
        with pytest.raises(InputError, match="label: expected a label from 1, several, or null, received"):
            MaskLabels.of(wrong, None, None)
    with pytest.raises(
        InputError, match="label: expected the vessel's label next to prediction_label or ignore_label"
    ):
        MaskLabels.of(None, 1, None)
    for wrong in (2, [3, 4]):
        with pytest.raises(InputError, match="ignore_label: expected one label, and not the vessel's"):
            MaskLabels.of(2, None, wrong)


def test_palettes_and_accents_do_not_change_a_score(tmp_path: Path) -> None:
    given, truth = tmp_path / "given", tmp_path / "truth"
    save(truth / "n\u00e9.png", square(20))
    given.mkdir()
    image = Image.fromarray((~square(20)).astype(np.uint8), "P")
    image.putpalette([255, 255, 255, 0, 0, 0])
    image.save(given / "ne\u0301.png")
    cases, pairs = table(given, truth)
    assert cases["dsc"].tolist() == [1.0] and not pairs.unused and not pairs.missing


def test_a_spacing_is_one_number_or_two() -> None:
    assert require_spacing(None) is None
    assert require_spacing(0.2) == (0.2, 0.2)
    assert require_spacing([0.3, 0.2]) == (0.3, 0.2)
    for wrong in (0, -1.0, "fine", [0.1], [0.1, 0.2, 0.3], True, [0.1, math.nan]):
        with pytest.raises(InputError, match="spacing_mm: expected one positive number, two"):
            require_spacing(wrong)
