"""What studies of repeated simulated sweeps share: one job a phantom, its settings, and the masks of its sweeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.variants import distinct_names
from experiments.errors import InputError
from experiments.outcome import JobResult
from experiments.paths import PathSetting
from registration.phantom.settings import MESH, PhantomSettings

if TYPE_CHECKING:
    import pandas as pd

    from registration.phantom.scan import SimulatedSweep

MASKS = ("exact", "model")


def phantom_jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each phantom.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.

    Returns
    -------
    list of dict
        What each job changes in the configuration.

    Raises
    ------
    InputError
        If ``phantoms`` is not a list of phantoms.
    """
    phantoms = config.get("phantoms")
    if not isinstance(phantoms, Sequence) or isinstance(phantoms, str) or not phantoms:
        raise InputError(f"phantoms: expected a list of phantoms, received {phantoms!r}")
    return [{"phantoms": [name]} for name in phantoms]


def settings_of_job(phantom: PhantomSettings, phantoms: Sequence[str]) -> PhantomSettings:
    """Return the settings of the one phantom of a job.

    Parameters
    ----------
    phantom : PhantomSettings
        Settings of the phantom.
    phantoms : sequence of str
        Name of the one phantom of the job.

    Returns
    -------
    PhantomSettings
        The settings with that name.

    Raises
    ------
    InputError
        If there are several, or a mesh is named without ``phantom.mesh``.
    """
    if len(phantoms) != 1:
        raise InputError(f"phantoms: expected one phantom a job, received {len(phantoms)}")
    if bool(phantom.mesh) != (phantoms[0] == MESH):
        raise InputError(
            f"phantoms: expected [{MESH}] with phantom.mesh and only then, received {phantoms[0]!r} "
            f"and phantom.mesh={phantom.mesh!r}"
        )
    return replace(phantom, subset=phantoms[0])


def rows_by_phantom(results: Sequence[JobResult]) -> pd.DataFrame | None:
    """Put the rows of all jobs together, those of one phantom that was treated otherwise under a name of its own.

    Parameters
    ----------
    results : sequence of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    pandas.DataFrame or None
        All rows; None where no job has any.
    """
    import pandas as pd

    kept = [result for result in results if result.cases is not None and len(result.cases)]
    tables = [result.cases for result in kept if result.cases is not None]
    if not tables:
        return None
    names = distinct_names(kept, [str(rows["phantom"].iloc[0]) for rows in tables], ("phantoms",))
    named = [rows.assign(phantom=name) for rows, name in zip(tables, names, strict=True)]
    return pd.concat(named, ignore_index=True)


def require_masks(masks: str, model_path: PathSetting | None) -> None:
    """Check which masks the sweeps are to have.

    Parameters
    ----------
    masks : str
        ``exact`` for the true masks, ``model`` for those of a network.
    model_path : PathSetting or None
        File of a trained network (``model.pt``) with ``masks=model``; None with ``masks=exact``.

    Raises
    ------
    InputError
        If there are no such masks, or the network is missing or not used.
    """
    if masks not in MASKS:
        raise InputError(f"masks: expected {' or '.join(MASKS)}, received {masks!r}")
    if (masks == "model") != (model_path is not None):
        raise InputError(f"model_path: expected a network with masks=model only, received {model_path!r}")
    if model_path is not None and not Path(model_path).is_file():
        raise InputError(
            f"model_path: expected a network trained by study=segmentation (model.pt), received {model_path!r}"
        )


def masks_by(model_path: PathSetting | None) -> Callable[[SimulatedSweep], np.ndarray]:
    """Return what gives the masks of a simulated sweep's frames.

    Parameters
    ----------
    model_path : PathSetting or None
        File of a trained network; None for the exact masks.

    Returns
    -------
    callable
        Masks, or the network's probabilities, of shape (n, height, width), of a sweep.
    """
    if model_path is None:
        return lambda sweep: sweep.masks
    from models.predictor import Predictor

    predictor = Predictor.load(model_path)
    return lambda sweep: predictor.probability(sweep.sweep.images)
