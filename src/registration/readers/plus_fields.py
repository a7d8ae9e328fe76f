"""Sequence files of PLUS of either kind, and what the fields of their frames say: times, transforms, status."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration.errors import InputError
from registration.readers.metaimage import metaimage_bytes, read_metaimage
from registration.readers.nrrd import nrrd_bytes, read_nrrd
from registration.readers.sequence import PlusSequence
from registration.readers.transform_graph import TransformGraph
from registration.whole import write_whole

TRANSFORM = "Transform"
CLOCKS = {"filtered": "Timestamp", "unfiltered": "UnfilteredTimestamp"}
SUFFIXES = (".mha", ".nrrd")


def read_sequence(path: Path, orientation: str | None = None) -> PlusSequence:
    """Read a sequence file of either kind, pixels turned to orientation MF.

    ``orientation`` overrules the file's own. Raises InputError, naming the file, for another suffix.
    """
    if path.suffix not in SUFFIXES:
        raise InputError(
            f"{path}: expected a file that ends in {' or '.join(SUFFIXES)}, received {path.suffix!r}"
        )
    return (read_metaimage if path.suffix == ".mha" else read_nrrd)(path, orientation)


def write_sequence(path: Path, sequence: PlusSequence, compressed: bool = True) -> None:
    """Write a sequence file as a whole, in the format that the suffix names."""
    if path.suffix not in SUFFIXES:
        raise InputError(
            f"{path}: expected a name that ends in {' or '.join(SUFFIXES)}, received {path.suffix!r}"
        )
    write_whole(path, (metaimage_bytes if path.suffix == ".mha" else nrrd_bytes)(sequence, compressed))


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

    It counts as valid where it is there and its status is OK or not given (files of old versions of PLUS).
    """
    key = f"{source}To{target}{TRANSFORM}"
    matrices = np.tile(np.eye(4), (len(sequence.frame_fields), 1, 1))
    valid = np.zeros(len(sequence.frame_fields), dtype=bool)
    for index, fields in enumerate(sequence.frame_fields):
        if key not in fields or fields.get(f"{key}Status", "OK") != "OK":
            continue
        numbers = np.array(fields[key].split(), dtype=np.float64)
        if numbers.shape != (16,):
            raise InputError(f"{name}: expected 16 numbers in {key} of frame {index}, found {len(numbers)}")
        matrices[index], valid[index] = numbers.reshape(4, 4), True
    return matrices, valid


def transform_names(sequence: PlusSequence) -> list[tuple[str, str]]:
    """The (from, to) pairs that any frame has a transform for, in the order in which they occur."""
    keys = dict.fromkeys(key for fields in sequence.frame_fields for key in fields if key.endswith(TRANSFORM))
    pairs = [key.removesuffix(TRANSFORM).partition("To") for key in keys]
    return [(source, target) for source, _, target in pairs if source and target]


def frame_graph(
    sequence: PlusSequence, path: Path
) -> tuple[TransformGraph, Mapping[tuple[str, str], np.ndarray]]:
    """All transforms of all frames as stacks, and where each is valid."""
    stacks = {pair: frame_transform(sequence, *pair, str(path)) for pair in transform_names(sequence)}
    # A frame without a valid transform holds whatever the tracker wrote: the identity keeps the chain invertible.
    return TransformGraph({pair: stack for pair, (stack, _) in stacks.items()}), {
        pair: valid for pair, (_, valid) in stacks.items()
    }
