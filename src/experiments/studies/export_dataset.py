"""Study ``export_dataset``: a data set as files, with its groups and its split, for other programs."""

from __future__ import annotations

from pathlib import Path

from experiments.datasets.export import NnUNetExport, roles_of, safe_names, write_folder
from experiments.datasets.protocol import DataSet, label_of, name_of, outside_groups, require_root
from experiments.errors import InputError
from experiments.outcome import Outcome, Progress
from experiments.splits.group_splits import GroupSplits
from experiments.splits.split_set import SplitSet
from models.labelled_frames import LabelledFrames

# An export measures nothing: the tracker would only keep a second copy of the files.
TRACKED = False
FORMATS = ("nnunet", "folder")


def check(*, dataset: DataSet, format: str, number: int, title: str | None, out: str | None = None) -> None:
    """Raise InputError for a format that is not known, a data set that is not there, a folder that is not empty."""
    if format not in FORMATS:
        raise InputError(f"format: expected {', '.join(FORMATS)}, received {format!r}")
    target = _exporter(dataset, number, title).folder if format == "nnunet" else "dataset"
    require_root(dataset)
    if out is not None:
        folder = Path(out).expanduser() / target
        # Files of another export would stay among the new ones.
        if folder.is_dir() and any(folder.iterdir()):
            raise InputError(
                f"out: expected no files in {folder}, found some; remove them or pass another out="
            )


def run(
    *,
    dataset: DataSet,
    split: GroupSplits,
    format: str,
    number: int,
    title: str | None,
    outer_fold: int | None,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Write the data set into ``workspace``: ``DatasetXXX_Name`` for nnU-Net, or ``dataset`` as the project reads it.

    nnU-Net gets the folds of one outer fold, where they are nested. A folder is written without a split where the data
    set can't be divided as ``split`` says, and the outcome says so.
    """
    progress.note(f"reading {name_of(dataset)}")
    frames = dataset()
    if format == "nnunet":
        splits = split(frames, **outside_groups(dataset)).of_outer_fold(outer_fold)
        root = _exporter(dataset, number, title)(workspace, frames, splits, progress)
        said = (
            f"its folds are those of splits_final.json, and sh {root.name}/run_nnunet.sh runs nnU-Net on them"
        )
    else:
        made, said = _split(dataset, frames, split)
        roles = roles_of(made) if made is not None and split.outer_folds is None else {}
        root = write_folder(workspace, frames, made, roles, progress)
    renamed = sum(case != name for case, name in safe_names(frames.case_ids).items())
    return Outcome(
        metrics={"images": float(len(frames)), "renamed": float(renamed)},
        findings=(
            f"{root.name}: {len(frames)} images of {label_of(dataset, frames)} in {len(set(frames.groups))} groups; "
            f"{said}. {renamed} cases have another name there (groups.csv, column original).",
        ),
    )


def _split(dataset: DataSet, frames: LabelledFrames, split: GroupSplits) -> tuple[SplitSet | None, str]:
    try:
        return split(frames, **outside_groups(dataset)), "its folds are in splits.json"
    except InputError as refusal:
        return None, f"without a split ({refusal})"


def _exporter(dataset: DataSet, number: int, title: str | None) -> NnUNetExport:
    return NnUNetExport(number, title or name_of(dataset), str(getattr(dataset, "target", "vessel")))
