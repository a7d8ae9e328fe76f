"""Grey values of a DICOM file as they are shown: through its rescaling and its window.

Attributes and their meaning: DICOM PS3.3, C.11.1 (Modality LUT), C.11.2 (VOI LUT), C.7.6.16 (functional groups).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64, Shaped, UInt8

from experiments.errors import InputError

if TYPE_CHECKING:
    from pydicom import Dataset

# Without a window, values must fill a quarter of what the stored bits allow: else nobody knows how many bits count.
_MIN_FILLED = 0.25


class GreyDisplay:
    """Stored grey values of a file to 8 bits, frame by frame.

    A window (WindowCenter and WindowWidth, the first of several; its function LINEAR, LINEAR_EXACT or SIGMOID) or a VOI
    LUT is applied to the rescaled values, as a viewer does; without either, the range that BitsStored allow becomes 0
    to 255. Both may stand in the functional groups, for all frames or for each.
    """

    def __init__(self, content: Dataset) -> None:
        self._content = content
        self._largest = 0
        self._scaled_by_bits = False

    def __call__(self, frame: Shaped[np.ndarray, "h w"], number: int) -> UInt8[np.ndarray, "h w"]:
        """Convert one frame to 8 bits.

        Parameters
        ----------
        frame : ndarray, shape (h, w)
            Stored values.
        number : int
            Number of the frame, from 0.

        Returns
        -------
        ndarray of uint8, shape (h, w)
            Grey values as a viewer shows them.
        """
        rescale = _with(self._content, number, "RescaleSlope", "ModalityLUTSequence")
        voi = _with(self._content, number, "WindowCenter", "VOILUTSequence")
        lut = next(iter(rescale.get("ModalityLUTSequence") or ()), None)
        slope, intercept = (
            float(rescale.get("RescaleSlope") or 1),
            float(rescale.get("RescaleIntercept") or 0),
        )
        values = _looked_up(frame, lut) if lut is not None else slope * frame.astype(np.float64) + intercept
        if voi.get("VOILUTSequence"):
            return _bytes(_looked_up(values, voi.VOILUTSequence[0]) / _lut_top(voi.VOILUTSequence[0]))
        if _is_window(voi):
            return _bytes(_windowed(values, voi))
        if lut is not None:
            return _bytes(values / _lut_top(lut))
        self._largest = max(self._largest, int(frame.max()))
        self._scaled_by_bits = True
        top = 2 ** int(self._content.BitsStored) - 1
        shares = np.minimum(frame, top) / top
        # A rescaling over the whole range changes nothing but the direction.
        return _bytes(1 - shares if slope < 0 else shares)

    def require_plausible(self, path: Path) -> None:
        """Check that values scaled by the bits stored do not use the lowest of them alone.

        Parameters
        ----------
        path : Path
            The file, for the message.

        Raises
        ------
        InputError
            If all frames converted so far use less than a quarter of the range and the file has no window.
        """
        bits = int(self._content.BitsStored)
        if self._scaled_by_bits and bits > 8 and 0 < self._largest < _MIN_FILLED * 2**bits:
            raise InputError(
                f"{path}: expected a window (WindowCenter, WindowWidth) or values that use the {bits} bits stored, "
                f"received none and values up to {self._largest}; write the window, or the BitsStored that count, "
                "into the file"
            )


def has_window(content: Dataset) -> bool:
    """Return whether the first frame, and so a file as its programs write it, has a window or a VOI LUT.

    Parameters
    ----------
    content : pydicom.Dataset
        The file.

    Returns
    -------
    bool
        Whether it has one.
    """
    voi = _with(content, 0, "WindowCenter", "VOILUTSequence")
    return _is_window(voi) or bool(voi.get("VOILUTSequence"))


def functional_groups(content: Dataset, number: int, kind: str) -> Iterator[Dataset]:
    """Iterate over the functional groups of one kind that hold for a frame.

    Parameters
    ----------
    content : pydicom.Dataset
        The file.
    number : int
        Number of the frame, from 0.
    kind : str
        Keyword of the sequence, such as ``PixelMeasuresSequence``.

    Yields
    ------
    pydicom.Dataset
        The items of the frame, then those shared by all frames.
    """
    per_frame = content.get("PerFrameFunctionalGroupsSequence") or ()
    for groups in (*per_frame[number : number + 1], *(content.get("SharedFunctionalGroupsSequence") or ())):
        yield from groups.get(kind) or ()


def _with(content: Dataset, number: int, *names: str) -> Dataset:
    """Return what has one of these attributes for a frame: a functional group, else the file itself."""
    kinds = ("FrameVOILUTSequence", "PixelValueTransformationSequence")
    groups = [item for kind in kinds for item in functional_groups(content, number, kind)]
    return next((item for item in groups if any(item.get(name) is not None for name in names)), content)


def _is_window(voi: Dataset) -> bool:
    # Some programs write a window of width 0 for none.
    return (
        bool(voi.get("WindowWidth")) and voi.get("WindowCenter") is not None and _first(voi.WindowWidth) > 0
    )


def _windowed(values: Float64[np.ndarray, "h w"], voi: Dataset) -> Float64[np.ndarray, "h w"]:
    """Shares of white (PS3.3, C.11.2.1.2 and C.11.2.1.3)."""
    centre, width = _first(voi.WindowCenter), _first(voi.WindowWidth)
    function = str(voi.get("VOILUTFunction") or "LINEAR").upper()
    if function == "SIGMOID":
        shares = 1 / (1 + np.exp(-4 * (values - centre) / width))
    elif function == "LINEAR_EXACT":
        shares = (values - centre) / width + 0.5
    elif width <= 1:
        shares = (values > centre - 0.5).astype(np.float64)
    else:
        shares = (values - (centre - 0.5)) / (width - 1) + 0.5
    return np.asarray(np.clip(shares, 0, 1))


def _looked_up(values: np.ndarray, lut: Dataset) -> Float64[np.ndarray, "h w"]:
    """Entries of a LUT; what lies before its first or behind its last is given that one (C.11.1.1)."""
    entries, first = int(lut.LUTDescriptor[0]) or 2**16, int(lut.LUTDescriptor[1])
    data = lut.LUTData
    if isinstance(data, bytes):
        table = np.frombuffer(data, dtype="<u2" if len(data) >= 2 * entries else "u1")[:entries]
    else:
        table = np.atleast_1d(np.asarray(data))
    if len(table) != entries:
        raise ValueError(f"a table of {len(table)} values where {entries} are announced")
    return np.asarray(
        table[np.clip(np.rint(values) - first, 0, entries - 1).astype(np.int64)], dtype=np.float64
    )


def _lut_top(lut: Dataset) -> int:
    return int(2 ** int(lut.LUTDescriptor[2]) - 1)


def _first(value: object) -> float:
    """One value, or the first of several."""
    return float(value[0] if hasattr(value, "__len__") and not isinstance(value, str) else value)  # type: ignore[index, arg-type]


def _bytes(shares: np.ndarray) -> UInt8[np.ndarray, "h w"]:
    return np.rint(np.clip(shares, 0, 1) * 255).astype(np.uint8)
