"""Anyone's masks next to reference masks: which files belong together, and which labels in them are the vessel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.datasets.images.image_files import image_files
from experiments.errors import InputError


@dataclass(frozen=True)
class MaskLabels:
    """Which values of the masks are the vessel.

    Parameters
    ----------
    reference : tuple of int or None, optional
        Labels of the vessel in the references; None for masks of 0 and 1, or 0 and 255.
    prediction : tuple of int or None, optional
        Labels of the vessel in the predictions; None for masks of 0 and 1, or 0 and 255.
    ignored : int or None, optional
        Label of pixels in the references that nobody labelled, which are not scored; None for none.
    """

    reference: tuple[int, ...] | None = None
    prediction: tuple[int, ...] | None = None
    ignored: int | None = None

    @staticmethod
    def of(label: Any, prediction_label: Any, ignore_label: Any) -> MaskLabels:
        """Read the labels from the settings.

        Parameters
        ----------
        label : Any
            Label or labels of the vessel in the references, or None.
        prediction_label : Any
            Label or labels of the vessel in the predictions; None for ``label``.
        ignore_label : Any
            Label of pixels in the references that nobody labelled, or None.

        Returns
        -------
        MaskLabels
            The labels.

        Raises
        ------
        InputError
            If a setting is no label, or they contradict each other.
        """
        reference = _labels("label", label)
        prediction = _labels("prediction_label", prediction_label)
        ignored = _labels("ignore_label", ignore_label)
        if reference is None and (prediction is not None or ignored is not None):
            raise InputError(
                "label: expected the vessel's label next to prediction_label or ignore_label, received none"
            )
        if ignored is not None and (len(ignored) > 1 or ignored[0] in (reference or ())):
            raise InputError(
                f"ignore_label: expected one label, and not the vessel's, received {ignore_label!r}"
            )
        return MaskLabels(reference, prediction or reference, None if ignored is None else ignored[0])


@dataclass(frozen=True)
class MaskPairs:
    """Reference masks with the predicted masks of the same names.

    Parameters
    ----------
    references : Mapping[str, Path]
        Files of the reference masks by name.
    predictions : Mapping[str, Path]
        Files of the predicted masks by name.
    unused : tuple of str
        Names of predictions that have no reference.
    spacing_mm : tuple[float, float] or None
        Pixel size (vertical, horizontal) in mm; None where it is not known.
    labels : MaskLabels, optional
        Labels that are scored.
    """

    references: Mapping[str, Path]
    predictions: Mapping[str, Path]
    unused: tuple[str, ...]
    spacing_mm: tuple[float, float] | None
    labels: MaskLabels = MaskLabels()

    @property
    def missing(self) -> list[str]:
        """The references without a prediction."""
        return [name for name in self.references if name not in self.predictions]


def pair_masks(
    prediction: Path, reference: Path, spacing_mm: Any, labels: MaskLabels = MaskLabels()
) -> MaskPairs:
    """Find the prediction that belongs to each reference, by name.

    One file is paired with one file whatever their names.

    Parameters
    ----------
    prediction : Path
        File or folder of the predicted masks.
    reference : Path
        File or folder of the reference masks.
    spacing_mm : Any
        Pixel size in mm: one number, two (vertical, horizontal) or None.
    labels : MaskLabels, optional
        Labels that are scored.

    Returns
    -------
    MaskPairs
        The pairs.

    Raises
    ------
    InputError
        If a file is set against a folder, no name is shared, or the spacing is invalid.
    """
    spacing = require_spacing(spacing_mm)
    if reference.is_file() and prediction.is_file():
        return MaskPairs({reference.stem: reference}, {reference.stem: prediction}, (), spacing, labels)
    if reference.is_file() or prediction.is_file():
        kinds = {True: "a file", False: "a folder"}
        raise InputError(
            f"prediction: expected {kinds[reference.is_file()]}, as reference is, received "
            f"{kinds[prediction.is_file()]} {prediction}"
        )
    references, found = image_files(reference), image_files(prediction)
    predictions = {name: path for name, path in found.items() if name in references}
    if not predictions:
        raise InputError(
            f"prediction: expected masks named as those in {reference} ({next(iter(references))}, ...), "
            f"received none of these names in {prediction}"
        )
    unused = tuple(name for name in found if name not in references)
    return MaskPairs(references, predictions, unused, spacing, labels)


def require_spacing(value: Any) -> tuple[float, float] | None:
    """Check a setting of the pixel size.

    Parameters
    ----------
    value : Any
        Pixel size in mm: one number, two (vertical, horizontal) or None.

    Returns
    -------
    tuple[float, float] or None
        Pixel size (vertical, horizontal) in mm; None if it is not known.

    Raises
    ------
    InputError
        If ``value`` is not one or two positive numbers or None.
    """
    if value is None:
        return None
    sides = list(value) if isinstance(value, (list, tuple)) else [value, value]
    known = all(isinstance(side, (int, float)) and not isinstance(side, bool) for side in sides)
    if len(sides) != 2 or not known or not all(np.isfinite(side) and side > 0 for side in sides):
        raise InputError(
            f"spacing_mm: expected one positive number, two (vertical, horizontal) or null, received {value!r}"
        )
    return float(sides[0]), float(sides[1])


def _labels(setting: str, value: Any) -> tuple[int, ...] | None:
    if value is None:
        return None
    labels = tuple(value) if isinstance(value, (list, tuple)) else (value,)
    are_labels = all(isinstance(one, int) and not isinstance(one, bool) and one > 0 for one in labels)
    if not labels or not are_labels:
        raise InputError(f"{setting}: expected a label from 1, several, or null, received {value!r}")
    return tuple(dict.fromkeys(labels))
