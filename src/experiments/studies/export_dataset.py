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
    """Check that the data set can be exported.

    Parameters
    ----------
    dataset : DataSet
        Data set.
    format : str
        ``nnunet`` or ``folder``.
    number : int
        Number of the nnU-Net data set.
    title : str or None
        Name of the nnU-Net data set; None for the data set's own.
    out : str or None, optional
        Folder to export into; None for the folder of the run.

    Raises
    ------
    InputError
        If the format is unknown, the data set does not exist, or the target folder is not empty.
    """
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
    """Write the data set into ``workspace``.

    It becomes ``DatasetXXX_Name`` for nnU-Net, or ``dataset`` as the project reads it. A nested split exports
    the folds of one outer fold to nnU-Net. A folder is written without a split where the data set cannot be
    divided as ``split`` says, and the outcome says so.

    Parameters
    ----------
    dataset : DataSet
        Data set.
    split : GroupSplits
        Division of the groups into training, validation and test.
    format : str
        ``nnunet`` or ``folder``.
    number : int
        Number of the nnU-Net data set.
    title : str or None
        Name of the nnU-Net data set; None for the data set's own.
    outer_fold : int or None
        Number of the outer fold; None where the split is not nested.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Numbers of images and of renamed cases, and findings.
    """
    progress.note(f"reading {name_of(dataset)}")
    frames = dataset()
    if format == "nnunet":
        splits = split(frames, **outside_groups(dataset)).of_outer_fold(outer_fold)
        root = _exporter(dataset, number, title)(workspace, frames, splits, progress)
        sentence = (
            f"its folds are those of splits_final.json, and sh {root.name}/run_nnunet.sh runs nnU-Net on them"
        )
    else:
        made, sentence = _split(dataset, frames, split)
        roles = roles_of(made) if made is not None and split.outer_folds is None else {}
        root = write_folder(workspace, frames, made, roles, progress)
    renamed = sum(case != name for case, name in safe_names(frames.case_ids).items())
    return Outcome(
        metrics={"images": float(len(frames)), "renamed": float(renamed)},
        findings=(
            f"{root.name}: {len(frames)} images of {label_of(dataset, frames)} in {len(set(frames.groups))} groups; "
            f"{sentence}. {renamed} cases have another name there (groups.csv, column original).",
        ),
    )


def _split(dataset: DataSet, frames: LabelledFrames, split: GroupSplits) -> tuple[SplitSet | None, str]:
    try:
        return split(frames, **outside_groups(dataset)), "its folds are in splits.json"
    except InputError as refusal:
        return None, f"without a split ({refusal})"


def _exporter(dataset: DataSet, number: int, title: str | None) -> NnUNetExport:
    return NnUNetExport(number, title or name_of(dataset), str(getattr(dataset, "target", "vessel")))
