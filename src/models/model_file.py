"""A segmentation model in one file: its networks and all that turns their outputs into masks.

Next to the weights it holds what has to be known to use and to trust them: preprocessing, calibration, thresholds,
the certificate of how the model was chosen, and the data that it was made from.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from models.atomic import atomic_write
from models.calibration.temperature import TemperatureScaling
from models.checkpoint import FORMAT as CHECKPOINT_FORMAT
from models.checkpoint import VERSION as CHECKPOINT_VERSION
from models.checkpoint import Checkpoint
from models.errors import InputError
from models.networks.registry import NetworkRecipe, recipe_of, settings_of
from models.postprocessing.hysteresis import Hysteresis
from models.postprocessing.morphology import Morphology
from models.postprocessing.options import Option
from models.preprocessing.preprocessing import Preprocessing
from models.value_types import require_settings
from models.weights_file import are_weights, network_with, read_weights_file, require_fitting

FORMAT = "ctus-model"
VERSION = 1


@dataclass(frozen=True)
class ModelMember:
    """One network of a model.

    Parameters
    ----------
    name : str
        Name of the network, such as ``average`` or ``fold 2``.
    recipe : NetworkRecipe
        Architecture.
    weights : mapping of str to Tensor
        State dict of the network.
    """

    name: str
    recipe: NetworkRecipe
    weights: Mapping[str, Tensor] = field(repr=False)

    def __repr__(self) -> str:
        """One line: its name, its kind and how large it is."""
        return f"ModelMember({self.name!r}, {self.recipe.name}, {self.parameters} parameters)"

    @property
    def parameters(self) -> int:
        """Number of values in the weights, running statistics included."""
        return sum(tensor.numel() for tensor in self.weights.values())

    def network(self) -> nn.Module:
        """Build the network with these weights.

        Returns
        -------
        nn.Module
            Network on the CPU in evaluation mode.
        """
        return network_with(self.recipe, self.weights)


@dataclass(frozen=True)
class SegmentationModel:
    """All that turns a frame into a mask, and what is known about it.

    The probability of several members is their mean; calibration applies to its logit, and thresholds and morphology
    to the calibrated probability.

    Parameters
    ----------
    members : tuple of ModelMember
        Networks, of different names; several are an ensemble of probabilities.
    preprocessing : Preprocessing
        Preprocessing that all of them expect.
    calibration : TemperatureScaling or None, optional
        Calibration of the logit of the probability; None leaves it as it is.
    postprocessing : Option or None, optional
        From probability to mask; None is a threshold of 0.5.
    min_presence : float or None, optional
        Frames whose probability of showing a vessel is below this (0 to 1) have an empty mask, where a network has
        such an output; None for no such gate.
    flips : bool, optional
        Whether probabilities are means over the frame and its mirror image (left to right).
    certificate : mapping, optional
        How the model was chosen: plain values.
    data : mapping, optional
        Data sets that it was made from, by name: digest, licence and the like, plain values.
    notes : mapping, optional
        Further plain values, such as measured scores.

    Raises
    ------
    InputError
        If there is no member, two have one name, or a value is out of range or not plain.
    """

    members: tuple[ModelMember, ...]
    preprocessing: Preprocessing
    calibration: TemperatureScaling | None = None
    postprocessing: Option | None = None
    min_presence: float | None = None
    flips: bool = False
    certificate: Mapping[str, Any] = field(default_factory=dict)
    data: Mapping[str, Any] = field(default_factory=dict)
    notes: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """One screen: members by name, settings, and which facts come with them."""
        names = ", ".join(member.name for member in self.members)
        facts = ", ".join(name for name in ("certificate", "data", "notes") if getattr(self, name)) or "none"
        return (
            f"SegmentationModel({len(self.members)} {self.members[0].recipe.name} ({names[:60]}),\n"
            f"    image_size_px={self.preprocessing.image_size_px}, flips={self.flips}, "
            f"min_presence={self.min_presence},\n"
            f"    calibration={self.calibration}, facts: {facts})"
        )

    def __post_init__(self) -> None:
        object.__setattr__(self, "members", tuple(self.members))
        names = [member.name for member in self.members]
        if not names or len(set(names)) < len(names):
            raise InputError(
                f"members: expected networks of different names, received {', '.join(names) or 'none'}"
            )
        for member in self.members:
            if self.preprocessing.image_size_px % member.recipe.multiple:
                raise InputError(
                    f"image_size_px: expected a multiple of {member.recipe.multiple} for {member.name}, "
                    f"received {self.preprocessing.image_size_px}"
                )
        if self.min_presence is not None and not 0 <= self.min_presence <= 1:
            raise InputError(f"min_presence: expected 0 to 1, received {self.min_presence}")
        for name in ("certificate", "data", "notes"):
            object.__setattr__(self, name, _plain(getattr(self, name), name))

    @property
    def digest(self) -> str:
        """SHA-256 of all that decides the masks: equal for two files exactly if they predict alike."""
        found = hashlib.sha256()
        for member in self.members:
            found.update(
                json.dumps([member.recipe.name, settings_of(member.recipe)], sort_keys=True).encode()
            )
            for name, tensor in sorted(member.weights.items()):
                found.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
                found.update(
                    tensor.detach().cpu().contiguous().reshape(-1).view(torch.uint8).numpy().tobytes()
                )
        found.update(json.dumps(self._settings(), sort_keys=True, default=list).encode())
        return found.hexdigest()

    def save(self, path: str | Path) -> None:
        """Write the file atomically.

        Parameters
        ----------
        path : str or Path
            Where the model is written; an existing file is replaced.
        """
        content = {
            "format": FORMAT,
            "version": VERSION,
            "members": [
                {
                    "name": member.name,
                    "network": member.recipe.name,
                    "settings": settings_of(member.recipe),
                    "weights": {name: t.detach().cpu().contiguous() for name, t in member.weights.items()},
                }
                for member in self.members
            ],
            **self._settings(),
            **{name: getattr(self, name) for name in ("certificate", "data", "notes")},
        }
        with atomic_write(Path(path)) as temporary:
            torch.save(content, temporary)

    @staticmethod
    def load(path: str | Path) -> SegmentationModel:
        """Read a model file, or the checkpoint of one fold as a model of one network.

        Parameters
        ----------
        path : str or Path
            File that ``save`` of this class or of ``Checkpoint`` wrote.

        Returns
        -------
        SegmentationModel
            Weights on the CPU.

        Raises
        ------
        InputError
            If the file is missing, damaged, of another program or version, or weights do not fit their recipe.
        """
        content = read_weights_file(
            Path(path), {FORMAT: VERSION, CHECKPOINT_FORMAT: CHECKPOINT_VERSION}, "model"
        )
        if content["format"] == CHECKPOINT_FORMAT:
            return model_of(Checkpoint.of(content, path), Path(path).stem)
        try:
            model = _model(content)
        except (KeyError, TypeError, AttributeError, InputError) as refusal:
            raise InputError(
                f"{path}: expected a model of known networks and settings, received another ({refusal})"
            ) from refusal
        for member in model.members:
            require_fitting(member.recipe, member.weights, f"{path} ({member.name})")
        return model

    def _settings(self) -> dict[str, Any]:
        """The plain values that decide the masks."""
        return {
            "preprocessing": dataclasses.asdict(self.preprocessing),
            "calibration": None if self.calibration is None else dataclasses.asdict(self.calibration),
            "postprocessing": None
            if self.postprocessing is None
            else dataclasses.asdict(self.postprocessing),
            "min_presence": self.min_presence,
            "flips": self.flips,
        }


def model_of(checkpoint: Checkpoint, name: str = "network") -> SegmentationModel:
    """Take a trained network for a model of its own, without calibration and with a threshold of 0.5.

    Parameters
    ----------
    checkpoint : Checkpoint
        Trained network.
    name : str, optional
        Name of its only member.

    Returns
    -------
    SegmentationModel
        The model.
    """
    member = ModelMember(name, checkpoint.recipe, checkpoint.weights)
    return SegmentationModel((member,), checkpoint.preprocessing, notes=checkpoint.notes)


def _model(content: Mapping[str, Any]) -> SegmentationModel:
    calibration, option = content["calibration"], content["postprocessing"]
    return SegmentationModel(
        tuple(_member(each) for each in content["members"]),
        _built(Preprocessing, content["preprocessing"], "preprocessing"),
        None if calibration is None else _built(TemperatureScaling, calibration, "calibration"),
        None
        if option is None
        else Option(
            _built(Hysteresis, option["hysteresis"], "hysteresis"),
            _built(Morphology, option["morphology"], "morphology"),
        ),
        content["min_presence"],
        bool(content["flips"]),
        content["certificate"],
        content["data"],
        content["notes"],
    )


def _member(content: Mapping[str, Any]) -> ModelMember:
    if not are_weights(content["weights"]):
        raise InputError("members: expected the weights of a network by name, received something else")
    return ModelMember(
        str(content["name"]), recipe_of(content["network"], content["settings"]), content["weights"]
    )


def _built(cls: Any, settings: Mapping[str, Any], where: str) -> Any:
    require_settings(cls, settings, where)
    return cls(**settings)


def _plain(value: Any, where: str) -> Any:
    """A copy that ``weights_only=True`` can read; InputError for what it can't."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner, f"{where}.{key}") for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner, f"{where}[{index}]") for index, inner in enumerate(value)]
    if value is None or type(value) in (bool, str, int, float):
        return value
    raise InputError(f"{where}: expected text, numbers, lists or mappings, received {type(value).__name__}")
