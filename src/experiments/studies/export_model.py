"""Study ``export_model``: a model file as an ONNX graph with its model card, and in the tracker's registry."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from experiments import files
from experiments.errors import InputError
from experiments.inputs.paths import input_data
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting
from experiments.tracking import Store
from experiments.tracking.model_registry import register_model
from models.export.model_card import model_card
from models.export.onnx import export_onnx
from models.inference.ensemble import MeanProbability
from models.model_file import SegmentationModel


def check(*, model_path: PathSetting, register_as: str | None) -> None:
    """Check that the model exists and has a name to be registered under.

    Parameters
    ----------
    model_path : PathSetting
        File of a model.
    register_as : str or None
        Name in the tracker's registry of models; None for none.

    Raises
    ------
    InputError
        If ``model_path`` is no file or the name is empty.
    """
    if not Path(model_path).expanduser().is_file():
        raise InputError(f"model_path: expected a model file or model.pt of a fold, received {model_path!r}")
    if register_as is not None and not register_as.strip():
        raise InputError(f"register_as: expected a name, received {register_as!r}")


def run(
    *,
    model_path: PathSetting,
    title: str,
    register_as: str | None,
    seed: int,
    workspace: Path,
    progress: Progress,
    store: Store,
) -> Outcome:
    """Write ``model.onnx``, checked against the networks, ``model_card.md`` and ``model.pt`` into ``workspace``.

    The graph takes preprocessed images (b, 1, s, s) and gives the mean probability of the networks; what comes before
    and after is in its metadata.

    Parameters
    ----------
    model_path : PathSetting
        File of a model.
    title : str
        Heading of the card.
    register_as : str or None
        Name under which the model becomes a new version in the tracker's registry; None for none.
    seed : int
        Seed of the images that the graph is checked with.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.
    store : Store
        The tracker.

    Returns
    -------
    Outcome
        The largest difference, and findings.

    Raises
    ------
    InputError
        If the file is no model, a package is missing, or the graph differs from the networks.
    """
    check(model_path=model_path, register_as=register_as)
    path = Path(model_path).expanduser()
    model = SegmentationModel.load(path)
    progress.note("exporting the networks")
    module = MeanProbability([member.network() for member in model.members], model.flips)
    about = {
        "digest": model.digest,
        "preprocessing": json.dumps(dataclasses.asdict(model.preprocessing)),
        "calibration": _json(model.calibration),
        "postprocessing": _json(model.postprocessing),
        "min_presence": json.dumps(model.min_presence),
        "data": json.dumps(model.data),
    }
    size = model.preprocessing.image_size_px
    checked = export_onnx(module, size, workspace / "model.onnx", about, seed)
    files.write_text(workspace / "model_card.md", model_card(model, title))
    model.save(workspace / "model.pt")
    said = [
        f"model.onnx ({checked.bytes / 1e6:.1f} MB) has the networks' probabilities to {checked.max_difference:.1e} on "
        f"{checked.images} images of noise.",
        "model_card.md describes the model; model.pt is the model file.",
    ]
    if register_as is not None:
        version = register_model(store, register_as, workspace / "model.pt", model)
        said.append(f"Registered as version {version} of {register_as!r}.")
    return Outcome(
        metrics={"max_difference": checked.max_difference, "onnx_bytes": float(checked.bytes)},
        findings=tuple(said),
        tags={"model_digest": model.digest[:16]},
        inputs=(input_data(path),),
    )


def _json(part: object) -> str:
    return json.dumps(None if part is None else dataclasses.asdict(part))  # type: ignore[call-overload]
