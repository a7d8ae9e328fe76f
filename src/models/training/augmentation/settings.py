"""An augmentation from the settings in a training's configuration file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from models.errors import InputError
from models.training.augmentation.intensity import Brightness, Contrast, DepthGain, Gamma, Speckle
from models.training.augmentation.pipeline import Augmentation
from models.training.augmentation.spatial import Affine, Elastic, Flip
from models.value_types import require_settings

# Of a ``_target_``, which configurations of the experiments have in place of a name.
PREFIX = "models.training.augmentation."
TRANSFORMS: dict[str, type[Any]] = {
    each.__name__: each for each in (Affine, Flip, Elastic, Speckle, DepthGain, Gamma, Contrast, Brightness)
}
# Field names in configurations of version 0.1, one flat mapping in which a probability of 0 left a transform out.
_FLAT_FIELDS: dict[type[Any], dict[str, str]] = {
    Affine: {
        "affine": "probability",
        "rotation_deg": "max_rotation_deg",
        "scale": "max_scale_change",
        "shift": "max_shift",
        "shear": "max_shear",
    },
    Flip: {"flip": "probability"},
    Elastic: {"elastic": "probability", "elastic_shift": "max_shift", "elastic_nodes": "control_points"},
    Speckle: {"speckle": "probability", "speckle_deviation": "std", "speckle_grain_px": "grain_px"},
    DepthGain: {"depth_gain": "probability", "depth_gain_factor": "max_change"},
    Gamma: {"gamma": "probability", "gamma_factor": "max_change"},
    Contrast: {"contrast": "probability", "contrast_factor": "max_change"},
    Brightness: {"brightness": "probability", "brightness_shift": "max_change"},
}


def augmentation_of(settings: object) -> Augmentation:
    """Build an augmentation from plain settings.

    Parameters
    ----------
    settings : object
        A list of transforms, each a mapping with its ``name`` (such as ``Affine``; or its ``_target_``, as in
        conf/augmentation) and its fields; or a mapping with that list under ``transforms``; or the flat mapping of
        version 0.1, whose trainings stay what they were. An empty mapping is the default augmentation.

    Returns
    -------
    Augmentation
        The transforms in their order.

    Raises
    ------
    InputError
        If there is no transform of a name, or it has no such field or refuses its value.
    """
    if isinstance(settings, Mapping):
        given = {key: value for key, value in settings.items() if key != "_target_"}
        if "transforms" not in given:
            return _from_flat(given)
        if len(given) > 1:
            raise InputError(f"augmentation: expected transforms alone, received {', '.join(sorted(given))}")
        settings = given["transforms"]
    if isinstance(settings, (str, Mapping)) or not isinstance(settings, Sequence):
        raise InputError(f"augmentation: expected a list of transforms, received {settings!r}")
    return Augmentation(tuple(_transform(index, each) for index, each in enumerate(settings)))


def _transform(index: int, settings: object) -> Any:
    if not isinstance(settings, Mapping):
        raise InputError(
            f"augmentation[{index}]: expected a mapping with a transform's name, received {settings!r}"
        )
    name = str(settings.get("name", settings.get("_target_", ""))).removeprefix(PREFIX)
    if name not in TRANSFORMS:
        raise InputError(
            f"augmentation[{index}]: expected a transform ({', '.join(TRANSFORMS)}), received {name!r}"
        )
    fields = {key: value for key, value in settings.items() if key not in ("name", "_target_")}
    return _built(TRANSFORMS[name], fields, f"augmentation[{index}]")


def _from_flat(settings: Mapping[str, Any]) -> Augmentation:
    known = {old for fields in _FLAT_FIELDS.values() for old in fields}
    unknown = sorted(set(settings) - known)
    if unknown:
        raise InputError(
            f"augmentation: expected a list of transforms, received settings {', '.join(unknown)}"
        )
    built = {
        kind: _built(
            kind, {new: settings[old] for old, new in fields.items() if old in settings}, "augmentation"
        )
        for kind, fields in _FLAT_FIELDS.items()
    }
    # The affine transform and the flip drew their numbers whenever there was any spatial transform.
    spatial = any(built[kind].probability for kind in (Affine, Flip, Elastic))
    kept = [each for kind, each in built.items() if each.probability or (spatial and kind in (Affine, Flip))]
    return Augmentation(tuple(kept))


def _built(kind: type[Any], fields: Mapping[str, Any], where: str) -> Any:
    require_settings(kind, fields, where)
    return kind(**fields)
