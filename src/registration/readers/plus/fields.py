"""Sequence files of PLUS of either kind, and what the fields of their frames hold: times, transforms, status."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.errors import InputError
from registration.input_files import refusing
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

    Parameters
    ----------
    path : Path
        MetaImage or NRRD sequence file.
    orientation : str, optional
        Orientation in place of the file's own.

    Returns
    -------
    PlusSequence
        Everything in the file.

    Raises
    ------
    InputError
        If the suffix is another, or the file is not what it must be.
    """
    read = _READ.get(path.suffix.lower())
    if read is None:
        raise InputError(
            f"{path}: expected a file that ends in {', '.join(SUFFIXES)}, received {path.suffix!r}"
        )
    with refusing(path, "a sequence of PLUS"):
        return read(path, orientation)


def write_sequence(path: Path, sequence: PlusSequence, compressed: bool = True) -> None:
    """Write a sequence file atomically, in the format that the suffix names.

    Parameters
    ----------
    path : Path
        MetaImage or NRRD sequence file.
    sequence : PlusSequence
        What to write.
    compressed : bool, optional
        Whether pixels are compressed.

    Raises
    ------
    InputError
        If the suffix is another.
    """
    write = _WRITTEN.get(path.suffix.lower())
    if write is None:
        raise InputError(
            f"{path}: expected a name that ends in {' or '.join(_WRITTEN)}, received {path.suffix!r}"
        )
    write_atomic(path, write(sequence, compressed))


def frame_times_s(sequence: PlusSequence, clock: str, name: str) -> Float64[np.ndarray, " n"]:
    """Read each frame's time.

    Parameters
    ----------
    sequence : PlusSequence
        Sequence with n frames.
    clock : {'filtered', 'unfiltered'}
        Which of two recorded times.
    name : str
        Name of the file, for messages.

    Returns
    -------
    ndarray, shape (n,)
        Times in s.

    Raises
    ------
    InputError
        If a frame has no such time, or one that is no number.
    """
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
    """Read the named transform of every frame and whether it is valid.

    It counts as valid where it is there, has an inverse, and its status is OK or not given (files of old
    versions of PLUS).

    Parameters
    ----------
    sequence : PlusSequence
        Sequence with n frames.
    source : str
        PLUS's name of the coordinate frame to map from.
    target : str
        PLUS's name of the coordinate frame to map to.
    name : str
        Name of the file, for messages.

    Returns
    -------
    matrices : ndarray, shape (n, 4, 4)
        Transforms.
    valid : ndarray of bool, shape (n,)
        Which are valid.

    Raises
    ------
    InputError
        If a transform is no matrix of 16 numbers.
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
    """List the (from, to) pairs that any frame has a transform for.

    Parameters
    ----------
    sequence : PlusSequence
        Sequence.
    known : collection of str, optional
        Coordinate frames that are sure to exist, for names that can be read in several ways.

    Returns
    -------
    list of (str, str)
        Pairs in the order in which they occur.
    """
    names = _names(sequence)
    found = resolve(names, known)
    return [found[name] for name in names if name in found]


def ambiguous_names(sequence: PlusSequence, known: Collection[str] = ()) -> list[str]:
    """List the transforms whose names could stand for several pairs; ``transform_names`` leaves them out.

    Parameters
    ----------
    sequence : PlusSequence
        Sequence.
    known : collection of str, optional
        Coordinate frames that are sure to exist.

    Returns
    -------
    list of str
        Names.
    """
    names = _names(sequence)
    found = resolve(names, known)
    return [name for name in names if name not in found and len(splits(name)) > 1]


def _names(sequence: PlusSequence) -> list[str]:
    keys = dict.fromkeys(key for fields in sequence.frame_fields for key in fields if key.endswith(TRANSFORM))
    return [key.removesuffix(TRANSFORM) for key in keys]
