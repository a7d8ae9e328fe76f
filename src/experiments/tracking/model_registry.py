"""Segmentation models in MLflow's registry, with signature and input example.

A registered model is an MLflow Python model made from ``served_model.py``, which is code and no pickle.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.errors import InputError
from experiments.files import names_in
from experiments.tracking.run_writer import ending
from experiments.tracking.store import Store

if TYPE_CHECKING:
    from models.model_file import SegmentationModel

EXPERIMENT = "models"
CODE = Path(__file__).with_name("served_model.py")
ARTIFACT = "model"


def register_model(store: Store, name: str, path: Path, model: SegmentationModel) -> int:
    """Register a model file as a new version of a named model.

    Parameters
    ----------
    store : Store
        The tracker.
    name : str
        Name in the registry; made if it is new.
    path : Path
        Model file.
    model : SegmentationModel
        Its content.

    Returns
    -------
    int
        Number of the version.

    Raises
    ------
    InputError
        If tracking is off, or the tracker refuses the name.
    """
    if not store.enabled:
        raise InputError("register_as: expected tracking.enabled=true, received false")
    from mlflow.exceptions import MlflowException

    client = store.client()
    tags = {"model_digest": model.digest[:16], "ctus.kind": "model"}
    with ending(store.start(EXPERIMENT, name, tags)) as run, tempfile.TemporaryDirectory() as folder:
        save_mlflow_model(path, model, Path(folder) / ARTIFACT)
        run.files(Path(folder), names_in(Path(folder)))
    try:
        if not client.search_registered_models(f"name = '{name}'"):
            client.create_registered_model(name)
        source = f"{client.get_run(run.run_id).info.artifact_uri}/{ARTIFACT}"
        version = client.create_model_version(name, source, run.run_id, tags={"digest": model.digest})
    except MlflowException as refusal:
        raise InputError(
            f"register_as: expected a name that the tracker takes, received {name!r} ({refusal})"
        ) from (refusal)
    return int(version.version)


def save_mlflow_model(path: Path, model: SegmentationModel, folder: Path) -> None:
    """Write a folder in MLflow's format of models: frames in, masks out.

    Parameters
    ----------
    path : Path
        Model file, which is copied.
    model : SegmentationModel
        Its content.
    folder : Path
        Folder to make.
    """
    import mlflow.pyfunc
    from mlflow.models import ModelSignature
    from mlflow.types import Schema, TensorSpec

    side = model.preprocessing.image_size_px
    shape = (-1, -1, -1)
    mlflow.pyfunc.save_model(
        path=folder,
        python_model=str(CODE),
        artifacts={"model": str(path)},
        signature=ModelSignature(
            Schema([TensorSpec(np.dtype(np.uint8), shape, "frames")]),
            Schema([TensorSpec(np.dtype(bool), shape, "masks")]),
        ),
        input_example={"frames": np.zeros((1, side, side), np.uint8)},
        # The package of this project and what it needs; torch is not asked for anew by MLflow.
        pip_requirements=["ctus"],
        metadata=_plain(model),
    )


def _plain(model: SegmentationModel) -> dict[str, Any]:
    return {"digest": model.digest, "certificate": dict(model.certificate), "data": dict(model.data)}
