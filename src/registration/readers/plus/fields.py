"""Sequence files of PLUS of either kind, and what the fields of their frames say: times, transforms, status."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.errors import InputError
from registration.io.atomic import write_atomic
from registration.readers.chain.names import resolve, splits
from registration.readers.plus.metaimage import metaimage_bytes, read_metaimage
from registration.readers.plus.nrrd import nrrd_bytes, read_nrrd
from registration.readers.plus.sequence import PlusSequence

TRANSFORM = "Transform"
CLOCKS = {"filtered": "Timestamp", "unfiltered": "UnfilteredTimestamp"}
# What is read, and by which of the two formats; what is written.
_READ = {".mha": read_metaimage, ".mhd": read_metaimage, ".nrrd": read_nrrd, ".nhdr": read_nrrd}
_WRITTEN = {".mha": metaimage_bytes, ".nrrd": nrrd_bytes}
SUFFIXES = tuple(_READ)


def read_sequence(path: Path, orientation: str | None = None) -> PlusSequence:
    """Read a sequence file of either kind, pixels turned to orientation MF.

    ``orientation`` overrules the file's own. Raises InputError, naming the file, for another suffix.
    """
    read = _READ.get(path.suffix.lower())
    if read is None:
        raise InputError(
            f"{path}: expected a file that ends in {', '.join(SUFFIXES)}, received {path.suffix!r}"
        )
    return read(path, orientation)


def write_sequence(path: Path, sequence: PlusSequence, compressed: bool = True) -> None:
    """Write a sequence file as a whole, in the format that the suffix names."""
    write = _WRITTEN.get(path.suffix.lower())
    if write is None:
        raise InputError(
            f"{path}: expected a name that ends in {' or '.join(_WRITTEN)}, received {path.suffix!r}"
        )
    write_atomic(path, write(sequence, compressed))


def frame_times_s(sequence: PlusSequence, clock: str, name: str) -> Float64[np.ndarray, "n"]:
    """Each frame's time by the ``filtered`` or ``unfiltered`` clock; ``name`` is the file's, for messages."""
    key = CLOCKS[clock]
    try:
        return np.array([float(fields[key]) for fields in sequence.frame_fields])
    except KeyError as failure:
        raise InputError(
            f"{name}: expected the field {key} of every frame, found frames without it"
        ) from failure
    except ValueError as failure:
        raise InputError(
            f"{name}: expected numbers in the field {key}, found another ({failure})"
        ) from failure


def frame_transform(
    sequence: PlusSequence, source: str, target: str, name: str
) -> tuple[Float64[np.ndarray, "n 4 4"], np.ndarray]:
    """The named transform of every frame and whether it is valid, (n,) bool.

    It counts as valid where it is there, has an inverse, and its status is OK or not given (files of old versions of
    PLUS).
    """
    key = f"{source}To{target}{TRANSFORM}"
    matrices = np.tile(np.eye(4), (len(sequence.frame_fields), 1, 1))
    valid = np.zeros(len(sequence.frame_fields), dtype=bool)
    for index, fields in enumerate(sequence.frame_fields):
        if key not in fields or fields.get(f"{key}Status", "OK") != "OK":
            continue
        words = fields[key].split()
        try:
            numbers = np.array(words, dtype=np.float64)
        except ValueError as failure:
            raise InputError(
                f"{name}: expected numbers in {key} of frame {index}, found {failure}"
            ) from failure
        if numbers.shape != (16,):
            raise InputError(f"{name}: expected 16 numbers in {key} of frame {index}, found {len(numbers)}")
        # What has no inverse is no measurement, and the identity keeps a chain through it invertible.
        if transforms.is_affine(numbers.reshape(4, 4)):
            matrices[index], valid[index] = numbers.reshape(4, 4), True
    return matrices, valid


def transform_names(sequence: PlusSequence, known: Collection[str] = ()) -> list[tuple[str, str]]:
    """The (from, to) pairs that any frame has a transform for, in the order in which they occur.

    ``known`` names frames of which it is sure that they exist, for names that can be read in several ways.
    """
    names = _names(sequence)
    found = resolve(names, known)
    return [found[name] for name in names if name in found]


def ambiguous_names(sequence: PlusSequence, known: Collection[str] = ()) -> list[str]:
    """The transforms whose names could stand for several pairs of frames; ``transform_names`` leaves them out."""
    names = _names(sequence)
    found = resolve(names, known)
    return [name for name in names if name not in found and len(splits(name)) > 1]


def _names(sequence: PlusSequence) -> list[str]:
    keys = dict.fromkeys(key for fields in sequence.frame_fields for key in fields if key.endswith(TRANSFORM))
    return [key.removesuffix(TRANSFORM) for key in keys]
