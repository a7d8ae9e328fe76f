"""Ultrasound frames with their vessel masks, as a data set hands them to training and to scoring."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import SupportsIndex

import numpy as np

from models.archives import require_whole_archive
from models.array_types import Bool, UInt8
from models.atomic import atomic_write
from models.errors import InputError
from models.pictures import frames_picture


@dataclass(frozen=True)
class LabelledFrames:
    """Cases of one data set: grey images, binary vessel masks, and what must not be separated.

    Parameters
    ----------
    images : tuple of ndarray of uint8, shape (h, w)
        Grey images; sizes may differ from case to case.
    masks : tuple of ndarray of bool, shape (h, w)
        Masks of the images' sizes.
    case_ids : tuple of str
        Unique ids.
    groups : tuple of str
        Subject, session or recording that must stay on one side of any split.
    spacing_mm : tuple of tuple of float, or None
        Vertical and horizontal size of a pixel in mm; None where unknown.
    simulated : bool
        Whether every result drawn from these frames is to be marked as such.

    Raises
    ------
    InputError
        If a case is not as expected; names the first.
    """

    # "_" is any size: one name for all would say that all cases are of one size.
    images: tuple[UInt8[np.ndarray, "_ _"], ...]
    masks: tuple[Bool[np.ndarray, "_ _"], ...]
    case_ids: tuple[str, ...]
    groups: tuple[str, ...]
    spacing_mm: tuple[tuple[float, float] | None, ...]
    simulated: bool

    def __post_init__(self) -> None:
        for name in ("masks", "case_ids", "groups", "spacing_mm"):
            if len(getattr(self, name)) != len(self.images):
                raise InputError(
                    f"{name}: expected one for each of {len(self.images)} images, "
                    f"received {len(getattr(self, name))}"
                )
        if len(set(self.case_ids)) != len(self.case_ids):
            twice = next(case for case in self.case_ids if self.case_ids.count(case) > 1)
            raise InputError(f"case_ids: expected unique names, received {twice!r} more than once")
        for case, image, mask, spacing in zip(
            self.case_ids, self.images, self.masks, self.spacing_mm, strict=True
        ):
            _check_case(case, image, mask, spacing)

    def __repr__(self) -> str:
        """One line: how many, of what, no pixels."""
        marked = ", simulated" if self.simulated else ""
        return f"LabelledFrames({len(self)} frames in {len(set(self.groups))} groups{marked})"

    def _repr_html_(self) -> str:
        return f"{escape(repr(self))}{frames_picture(self.images, self.masks, self.case_ids) if len(self) else ''}"

    def __len__(self) -> int:
        return len(self.images)

    def subset(self, indices: Iterable[SupportsIndex]) -> LabelledFrames:
        """Select cases.

        Parameters
        ----------
        indices : iterable of int
            Places of the cases, in the order of the result.

        Returns
        -------
        LabelledFrames
            These cases.
        """
        chosen = [int(index) for index in indices]
        return LabelledFrames(
            images=tuple(self.images[i] for i in chosen),
            masks=tuple(self.masks[i] for i in chosen),
            case_ids=tuple(self.case_ids[i] for i in chosen),
            groups=tuple(self.groups[i] for i in chosen),
            spacing_mm=tuple(self.spacing_mm[i] for i in chosen),
            simulated=self.simulated,
        )

    def digest(self) -> str:
        """Compute the hash that identifies the data set.

        Returns
        -------
        str
            SHA-256 over every image, mask, name, group and spacing.
        """
        total = hashlib.sha256()
        for case in zip(self.images, self.masks, self.case_ids, self.groups, self.spacing_mm, strict=True):
            image, mask, *rest = case
            total.update(repr((image.shape, *rest)).encode())
            total.update(image.tobytes())
            total.update(np.packbits(mask).tobytes())
        return total.hexdigest()

    def save(self, path: Path) -> None:
        """Write one ``.npz`` file, from which a machine without the data set can train.

        Parameters
        ----------
        path : Path
            File to write.
        """
        unknown = (np.nan, np.nan)
        arrays: dict[str, np.ndarray] = {f"image_{i}": image for i, image in enumerate(self.images)}
        arrays |= {f"mask_{i}": mask for i, mask in enumerate(self.masks)}
        arrays |= {
            "case_ids": np.array(self.case_ids, dtype=np.str_),
            "groups": np.array(self.groups, dtype=np.str_),
            "spacing_mm": np.array([spacing or unknown for spacing in self.spacing_mm]).reshape(-1, 2),
            "simulated": np.array(self.simulated),
        }
        with atomic_write(path) as temporary:
            np.savez_compressed(temporary, **arrays)  # type: ignore[arg-type]

    @staticmethod
    def load(path: str | Path) -> LabelledFrames:
        """Read what ``save`` wrote.

        Parameters
        ----------
        path : str or Path
            File to read.

        Returns
        -------
        LabelledFrames
            The cases.

        Raises
        ------
        InputError
            If the file is missing, damaged or of another kind.
        """
        try:
            require_whole_archive(Path(path))
            with np.load(path, allow_pickle=False) as content:
                spacings = content["spacing_mm"].tolist()
                count = range(len(spacings))
                return LabelledFrames(
                    images=tuple(content[f"image_{i}"] for i in count),
                    masks=tuple(content[f"mask_{i}"] for i in count),
                    case_ids=tuple(content["case_ids"].tolist()),
                    groups=tuple(content["groups"].tolist()),
                    spacing_mm=tuple((v, h) if v == v else None for v, h in spacings),
                    simulated=bool(content["simulated"]),
                )
        except Exception as error:  # of NumPy, of the archive, of what it unpacks with
            raise InputError(
                f"{path}: expected a file of labelled frames, received none that can be read ({error})"
            ) from error


def _check_case(case: str, image: np.ndarray, mask: np.ndarray, spacing: tuple[float, float] | None) -> None:
    if image.dtype != np.uint8 or image.ndim != 2 or image.size == 0:
        raise InputError(
            f"images: expected uint8 of shape (height, width), received {image.dtype} {image.shape} in case {case}"
        )
    if mask.dtype != np.bool_:
        raise InputError(f"masks: expected bool, received {mask.dtype} in case {case}")
    if mask.shape != image.shape:
        raise InputError(
            f"masks: expected the image's size {image.shape}, received {mask.shape} in case {case}"
        )
    if spacing is not None and not all(np.isfinite(side) and side > 0 for side in spacing):
        raise InputError(
            f"spacing_mm: expected positive pixel sizes or None, received {spacing} in case {case}"
        )
