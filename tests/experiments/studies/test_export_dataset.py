from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
from drawn_vessels import drawn_frames

from experiments.datasets.folder import Folder
from experiments.datasets.nnunet import NnUNet
from experiments.datasets.protocol import outside_groups
from experiments.datasets.usgra import Usgra
from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.splits.group_splits import GroupSplits
from experiments.studies import export_dataset
from models.labelled_frames import LabelledFrames


@dataclasses.dataclass(frozen=True)
class Drawn:
    """Drawn frames; two groups are kept for the test."""

    groups: int = 8
    target: str = "nerve"
    name: str = "drawn"

    def __call__(self) -> LabelledFrames:
        return drawn_frames(3 * self.groups, per_group=3)

    def test_groups(self) -> tuple[str, ...]:
        return ("sweep0", "sweep1")


def export(workspace: Path, **changes: object) -> Outcome:
    workspace.mkdir(parents=True, exist_ok=True)
    arguments = {
        "dataset": Drawn(),
        "split": GroupSplits(3),
        "format": "nnunet",
        "number": 42,
        "title": None,
        "outer_fold": None,
    }
    return export_dataset.run(**{**arguments, **changes}, workspace=workspace, progress=Silent())


def test_the_data_sets_own_name_target_and_test_groups_are_used(tmp_path) -> None:
    outcome = export(tmp_path)
    root = tmp_path / "Dataset042_drawn"
    assert json.loads((root / "dataset.json").read_text())["labels"] == {"background": 0, "nerve": 1}
    dataset = NnUNet(str(root), target="nerve", cache=None)
    assert dataset.test_groups() == ("sweep0", "sweep1")
    assert outcome.metrics == {"images": 24.0, "renamed": 0.0}
    assert outcome.findings[0].startswith("Dataset042_drawn: 24 images of drawn (simulated) in 8 groups")
    export(tmp_path / "other", title="Other")
    assert (tmp_path / "other" / "Dataset042_Other" / "dataset.json").is_file()


def test_a_folder_is_written_with_and_without_a_split(tmp_path) -> None:
    outcome = export(tmp_path, format="folder")
    assert "its folds are in splits.json" in outcome.findings[0]
    root = tmp_path / "dataset"
    frames = Folder(str(root))()
    assert frames.case_ids == Drawn()().case_ids
    recipe = GroupSplits(file=str(root / "splits.json"))
    assert recipe(frames, test_groups=("sweep0", "sweep1")) == GroupSplits(3)(
        Drawn()(), **outside_groups(Drawn())
    )
    few = export(tmp_path / "few", dataset=Drawn(groups=4), format="folder")
    assert "without a split (folds: expected at least 3 groups" in few.findings[0]
    assert not (tmp_path / "few" / "dataset" / "splits.json").exists()


def test_a_nested_split_needs_the_number_of_the_outer_fold(tmp_path) -> None:
    nested = GroupSplits(2, outer_folds=2)
    with pytest.raises(InputError, match="outer_fold: expected one of 0, 1, received None"):
        export(tmp_path, dataset=lambda: Drawn()(), split=nested)
    export(tmp_path, dataset=lambda: Drawn()(), split=nested, outer_fold=1, title="drawn")
    dataset = NnUNet(str(tmp_path / "Dataset042_drawn"), cache=None)
    assert len(dataset.test_groups()) == 4
    export(tmp_path / "folder", dataset=lambda: Drawn()(), split=nested, format="folder")
    table = (tmp_path / "folder" / "dataset" / "groups.csv").read_text()
    assert table.splitlines()[0] == "case,group,vertical_mm,horizontal_mm"


def test_refuses_a_format_and_a_folder_with_files(tmp_path) -> None:
    settings = {"dataset": Drawn(), "format": "nnunet", "number": 42, "title": None, "out": str(tmp_path)}
    export_dataset.check(**settings)
    with pytest.raises(InputError, match="format: expected nnunet, folder, received 'coco'"):
        export_dataset.check(**{**settings, "format": "coco"})
    with pytest.raises(InputError, match="number: expected a data set number of 1 to 999, received 0"):
        export_dataset.check(**{**settings, "number": 0})
    (tmp_path / "Dataset042_drawn").mkdir()
    export_dataset.check(**settings)
    (tmp_path / "Dataset042_drawn" / "x").write_text("")
    with pytest.raises(InputError, match=r"out: expected no files in .*Dataset042_drawn, found some"):
        export_dataset.check(**settings)


def test_real_images_come_back_with_the_same_folds(real_data, tmp_path) -> None:
    # A quarter of them, of all three sizes, with groups of more than one: the whole set takes half a minute.
    for path in sorted((real_data / "usgra").glob("*/*.png")):
        if int(path.stem) < 10 or int(path.stem) % 5 == 0 or path.stem in ("0043", "0077"):
            copy = tmp_path / "some" / path.parent.name / path.name
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.symlink_to(path)
    frames = Usgra(str(tmp_path / "some"), cache=None)()
    assert len({image.shape for image in frames.images}) == 3 and len(set(frames.groups)) < len(frames)
    split = GroupSplits(5, selection_share=0.15, test_share=0.2)
    export(tmp_path, dataset=lambda: frames, split=split, number=501, title="usgra")
    root = tmp_path / "Dataset501_usgra"
    dataset = NnUNet(str(root), cache=None)
    read = dataset()
    assert read.digest() == frames.digest()
    for name in ("splits.json", "splits_final.json"):
        assert GroupSplits(file=str(root / name))(read, **outside_groups(dataset)) == split(frames)
