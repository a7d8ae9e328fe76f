"""A probe's calibration in a file of its own: YAML of this project, or a device set or result of PLUS."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from registration.calibration.probe import with_third_column
from registration.errors import InputError
from registration.input_files import LARGEST_TEXT_BYTES, guarded
from registration.readers.plus.config import read_device_set
from registration.sweep import ProbeCalibration
from registration.text_files import read_text
from registration.yaml_nodes import load_yaml

# Pixels of ultrasound images measure 0.02 to 0.5 mm. A thousandth of that was written in metres.
_MIN_PIXEL_MM = 2e-3


@guarded("a calibration", LARGEST_TEXT_BYTES)
def read_calibration(path: Path, image: str = "Image", probe: str = "Probe") -> ProbeCalibration:
    """Read a calibration from YAML or from PLUS's XML.

    Parameters
    ----------
    path : Path
        YAML file with the keys ``probe_A_pixel`` and, by default the identity, ``ee_T_probe``; or XML, of
        which the chain from ``image`` to ``probe`` is taken and ``ee_T_probe`` is the identity.
    image : str, optional
        PLUS's name of the image.
    probe : str, optional
        PLUS's name of the probe.

    Returns
    -------
    ProbeCalibration
        Where the image lies on the end effector.

    Raises
    ------
    InputError
        If the file is missing or of another kind, or holds no calibration.
    """
    if path.suffix.lower() == ".xml":
        try:
            probe_A_pixel = read_device_set(path).transforms.chain(image, probe)
        except InputError as failure:
            raise InputError(f"{path}: {failure}") from failure
        return ProbeCalibration(ee_T_probe=np.eye(4), probe_A_pixel=probe_A_pixel)
    return calibration_from(read_yaml(path), str(path))


def calibration_from(content: Mapping[str, Any], name: str) -> ProbeCalibration:
    """Read the calibration in the keys of a YAML file.

    Parameters
    ----------
    content : mapping of str to Any
        Content of the file.
    name : str
        Name of the file, for messages.

    Returns
    -------
    ProbeCalibration
        Where the image lies on the end effector.

    Raises
    ------
    InputError
        If ``probe_A_pixel`` is missing, a matrix is not what it must be, or pixels are too small to be in mm.
    """
    probe_A_pixel = matrix_from(content, "probe_A_pixel", name)
    try:
        probe_A_pixel = with_third_column(probe_A_pixel)
    except InputError as refusal:
        raise InputError(f"{name}: {refusal}") from refusal
    pixel_mm = float(np.linalg.norm(probe_A_pixel[:3, :2], axis=0).min())
    if pixel_mm < _MIN_PIXEL_MM:
        raise InputError(
            f"{name}: expected probe_A_pixel in millimetres, found pixels of {pixel_mm:.3g} (were they metres?)"
        )
    ee_T_probe = matrix_from(content, "ee_T_probe", name) if "ee_T_probe" in content else np.eye(4)
    try:
        return ProbeCalibration(ee_T_probe=ee_T_probe, probe_A_pixel=probe_A_pixel)
    except InputError as refusal:
        raise InputError(f"{name}: {refusal}") from refusal


def matrix_from(content: Mapping[str, Any], key: str, name: str) -> np.ndarray:
    """Read a 4x4 matrix given by its rows.

    Parameters
    ----------
    content : mapping of str to Any
        Content of a YAML file.
    key : str
        Key of the matrix, whose last row may be left out.
    name : str
        Name of the file, for messages.

    Returns
    -------
    ndarray, shape (4, 4)
        Matrix.

    Raises
    ------
    InputError
        If the key is missing or there are no three or four rows of four numbers.
    """
    try:
        rows = np.array(content[key], dtype=np.float64)
    except KeyError as failure:
        raise InputError(
            f"{name}: expected the key {key}, found {', '.join(map(str, content)) or 'none'}"
        ) from failure
    except (TypeError, ValueError) as failure:
        raise InputError(
            f"{name}: expected {key} as four rows of four numbers, found {content[key]!r}"
        ) from failure
    if rows.shape == (3, 4):
        rows = np.vstack([rows, [0.0, 0.0, 0.0, 1.0]])
    if rows.shape != (4, 4) or not np.isfinite(rows).all():
        raise InputError(f"{name}: expected {key} as four rows of four numbers, found shape {rows.shape}")
    return rows


@guarded("YAML", LARGEST_TEXT_BYTES)
def read_yaml(path: Path) -> dict[str, Any]:
    """Read the mapping in a YAML file.

    Parameters
    ----------
    path : Path
        YAML file.

    Returns
    -------
    dict of str to Any
        Its content.

    Raises
    ------
    InputError
        If the file cannot be read, holds no mapping, or has a key twice.
    """
    try:
        text = read_text(path)
        content, root = load_yaml(text)
    except InputError as refusal:
        raise InputError(
            str(refusal) if str(refusal).startswith(str(path)) else f"{path}: {refusal}"
        ) from refusal
    except yaml.YAMLError as failure:
        raise InputError(f"{path}: expected YAML, found text that does not parse") from failure
    if not isinstance(content, dict) or root is None:
        raise InputError(f"{path}: expected a mapping of keys to values, found {type(content).__name__}")
    keys = [str(key.value) for key, _ in root.value] if root is not None else []
    twice = sorted({key for key in keys if keys.count(key) > 1})
    if twice:  # PyYAML takes the last one
        raise InputError(f"{path}: expected each key once, found {', '.join(twice)} twice")
    return content


def calibration_yaml(calibration: ProbeCalibration) -> str:
    """Format a calibration as YAML, exact to the last bit.

    Parameters
    ----------
    calibration : ProbeCalibration
        Where the image lies on the end effector.

    Returns
    -------
    str
        The keys ``probe_A_pixel`` and ``ee_T_probe``.
    """
    lines = []
    for key, matrix in (("probe_A_pixel", calibration.probe_A_pixel), ("ee_T_probe", calibration.ee_T_probe)):
        lines.append(f"{key}:")
        lines += ["  - [" + ", ".join(_exact(number) for number in row) + "]" for row in matrix]
    return "\n".join(lines) + "\n"


def _exact(number: float) -> str:
    # YAML 1.1 reads an exponent only after a decimal point: 1e-05 would be text.
    text = repr(float(number))
    return text if "e" not in text or "." in text else text.replace("e", ".0e")
