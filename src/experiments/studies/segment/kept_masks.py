"""Masks that are kept as they are made, by what the frame and the model are, so that no frame is segmented twice."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from experiments import files
from experiments.paths import project_root
from registration.io.atomic import atomic_write


@dataclass(frozen=True)
class KeptMasks:
    """Folder of the masks of one model; it may be deleted at any time.

    Parameters
    ----------
    folder : Path
        The folder.
    """

    folder: Path

    @classmethod
    def of(cls, *identity: object) -> KeptMasks:
        """Find the folder of a model with its settings.

        Parameters
        ----------
        *identity : object
            What decides the masks, by its ``repr``.

        Returns
        -------
        KeptMasks
            The folder, which need not exist.
        """
        name = hashlib.sha256(repr(identity).encode()).hexdigest()[:16]
        return cls(project_root() / ".cache" / "segment" / name)

    def row(self, key: str) -> dict[str, Any] | None:
        """Read what is known of a frame's mask.

        Parameters
        ----------
        key : str
            What the frame is.

        Returns
        -------
        dict or None
            What ``write`` was given; None if there is no mask.
        """
        try:
            row = json.loads(self._place(key, ".json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return row if isinstance(row, dict) and self.mask_file(key).is_file() else None

    def mask_file(self, key: str) -> Path:
        """Tell where a frame's mask lies.

        Parameters
        ----------
        key : str
            What the frame is.

        Returns
        -------
        Path
            A PNG file of 0 and 255.
        """
        return self._place(key, ".png")

    def write(self, key: str, mask: np.ndarray, row: dict[str, Any]) -> None:
        """Keep a mask.

        Parameters
        ----------
        key : str
            What the frame is.
        mask : ndarray of bool, shape (h, w)
            The mask.
        row : dict
            What is known of it, plain values.
        """
        with atomic_write(self.mask_file(key)) as temporary:
            Image.fromarray(np.where(mask, np.uint8(255), np.uint8(0))).save(temporary)
        # The row is written last: a mask without one does not count.
        files.write_text(self._place(key, ".json"), json.dumps(row, allow_nan=False))

    def _place(self, key: str, suffix: str) -> Path:
        name = hashlib.sha256(key.encode()).hexdigest()
        return self.folder / name[:2] / f"{name[2:34]}{suffix}"
