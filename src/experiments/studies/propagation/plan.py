"""Jobs of the study of propagation: what makes the masks of each, what is refused, and what the dashboard shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.segmentation.configurations import configuration_jobs, configured, names_of
from experiments.analysis.segmentation.fold_run import require_fitting_size, require_start
from experiments.datasets.protocol import DataSet, require_root
from experiments.errors import InputError, require_count
from experiments.inputs.surfaces import one_method
from experiments.paths import PathSetting
from experiments.studies.propagation.networks import REFERENCE
from experiments.studies.propagation.sweeps import Sweeps
from registration.phantom.session_variation import SessionVariation
from registration.phantom.settings import PhantomSettings

if TYPE_CHECKING:
    from models.networks.registry import NetworkRecipe
    from models.preprocessing.preprocessing import Preprocessing
    from models.training.initialisation import Initialisation

# What only a training has; the dashboard has no columns for it where nothing was trained.
OF_TRAINING = ("split", "model", "preprocessing", "budget", "augmentation", "loss", "init", "fold")


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for the reference masks, and one for each configuration and fold, or for each model file.

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
        If a configuration is unknown or there twice, the data set has none, there is not one model file for each, or
        the split has outer folds or is read from a file.
    """
    names = names_of(config)
    if len(set(names)) < len(names):
        raise InputError(f"configurations: expected each once, received {list(names)}")
    own, paths = [name for name in names if name != REFERENCE], config.get("model_paths")
    if paths is None or not own:
        found = configuration_jobs(config, own) if own else []
    elif isinstance(paths, str) or len(paths) != len(own):
        raise InputError(
            f"model_paths: expected a list with one file for each of configurations but {REFERENCE} "
            f"({', '.join(own) or 'none'}), received {paths!r}"
        )
    else:
        found = [
            {"configurations": [name], "model_paths": [path]} for name, path in zip(own, paths, strict=True)
        ]
    return [{"configurations": [REFERENCE]}, *found] if REFERENCE in names else found


def check(
    *,
    dataset: DataSet,
    configurations: Sequence[str],
    model_paths: Sequence[PathSetting] | None,
    model: NetworkRecipe,
    preprocessing: Preprocessing,
    init: Initialisation,
    phantom: PhantomSettings,
    phantoms: Sequence[str],
    sessions: SessionVariation | None,
    first_sweep: int,
    sweeps: int,
    samples: int,
    cache: str,
    rigid: Mapping[str, Any],
    deformable: Mapping[str, Any],
) -> None:
    """Check that what makes the masks is there, and that there are sweeps and one method a stage.

    Parameters
    ----------
    dataset : DataSet
        San Raffaele.
    configurations : sequence of str
        Name of the one configuration of the job.
    model_paths : sequence of PathSetting or None
        Model file of the job; None where it trains a network.
    model : NetworkRecipe
        Recipe of the network.
    preprocessing : Preprocessing
        Preprocessing of the images.
    init : Initialisation
        Weights to start from.
    phantom : PhantomSettings
        Settings of the phantom.
    phantoms : sequence of str
        Names of the phantoms.
    sessions : SessionVariation or None
        What differs between the sweeps.
    first_sweep : int
        Number of the first sweep.
    sweeps : int
        Number of sweeps of each phantom.
    samples : int
        Number of places on each surface where distances are measured, at least 1.
    cache : str
        Folder that keeps the pictures.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    deformable : Mapping[str, Any]
        Settings of exactly one deformable registration method by its name; ``none`` for no such method.

    Raises
    ------
    InputError
        If something is missing or out of range.
    """
    one_method(rigid)
    one_method(deformable, "deformable")
    require_count("samples", samples, 1)
    Sweeps(phantom, phantoms, first_sweep, sweeps, sessions, cache)
    for path in model_paths or ():
        if not Path(path).is_file():
            raise InputError(
                f"model_paths: expected model files or networks trained by study=segmentation (model.pt), "
                f"received {path!r}"
            )
    if model_paths is None and list(configurations) != [REFERENCE]:
        require_fitting_size(model, preprocessing)
        own = configured(dataset, configurations)
        require_start(init, model, own)
        require_root(own)


def parameters(config: Mapping[str, Any]) -> dict[str, Any]:
    """Name the configuration of a job, for the dashboard's columns, and leave out what it does not use.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the job.

    Returns
    -------
    dict
        Values by name.
    """
    names, paths = list(config["configurations"]), config.get("model_paths")
    found = {"configuration": names, "phantom": config["phantoms"], "sweeps": config["sweeps"]}
    if names == [REFERENCE] or paths is not None:
        found |= dict.fromkeys(OF_TRAINING, "")
    if paths is not None:
        found |= {"dataset": "", "model_paths": "", "model": "" if names == [REFERENCE] else paths}
    return found
