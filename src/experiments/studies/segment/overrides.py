"""Settings of a call that take the place of a model's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from experiments.errors import InputError
from models.model_file import SegmentationModel
from models.postprocessing.hysteresis import Hysteresis
from models.postprocessing.morphology import Morphology
from models.postprocessing.options import Option


def overridden(model: SegmentationModel, settings: Mapping[str, Any]) -> SegmentationModel:
    """Replace a model's thresholds and switches by those that a call gives.

    Parameters
    ----------
    model : SegmentationModel
        The model.
    settings : mapping
        ``threshold`` (a plain one, for both of the hysteresis), fields of ``Hysteresis`` and ``Morphology``,
        ``min_presence`` and ``flips``; None keeps the model's own.

    Returns
    -------
    SegmentationModel
        The model with these settings.

    Raises
    ------
    InputError
        If a value is out of range, or ``threshold`` is given together with ``low`` or ``high``.
    """
    given = {name: value for name, value in settings.items() if value is not None}
    if "threshold" in given:
        if given.keys() & {"low", "high"}:
            raise InputError("threshold: expected none with low or high, received both")
        low = given.pop("threshold")
        given |= {"low": low, "high": low}
    before = model.postprocessing or Option(Hysteresis(), Morphology())
    parts = {
        each: {field.name: given.pop(field.name) for field in dataclasses.fields(each) if field.name in given}
        for each in (Hysteresis, Morphology)
    }
    after = Option(
        dataclasses.replace(before.hysteresis, **parts[Hysteresis]),
        dataclasses.replace(before.morphology, **parts[Morphology]),
    )
    return dataclasses.replace(model, postprocessing=after, **given)
