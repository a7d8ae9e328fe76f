"""Predictions of a network in one small file: logits at the network's resolution and masks at the native one.

A file is a zip archive of pictures that any viewer opens. ``index.json`` names the cases, their groups, sizes and
parts, the fold and the preprocessing. ``logits/<number>.png`` has 16 bits: the logit is
``(value - LOGIT_ZERO) * LOGIT_STEP``, in the part of the network's square that the frame fills.
``masks/<number>.png`` has 1 bit and the frame's own size. About 6 to 12 kB a case at 128 px.
"""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float32
from PIL import Image

from experiments.errors import InputError
from models.atomic import atomic_write

if TYPE_CHECKING:
    from models.evaluation import CasePrediction
    from models.preprocessing.preprocessing import Preprocessing

FILE = "predictions.zip"
FORMAT, VERSION = "ctus-predictions", 1
# An error of 1/128 of a logit changes no probability by more than 0.002.
LOGIT_STEP, LOGIT_ZERO = 1 / 64, 2**15


class PredictionWriter:
    """Adds one case after the other to an open file; none is kept in memory."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self.cases: list[dict[str, Any]] = []

    def add(self, prediction: CasePrediction, group: str, part: str) -> None:
        """Add a case.

        Parameters
        ----------
        prediction : CasePrediction
            Logits and mask.
        group : str
            Group of the case.
        part : str
            Part of the split that it is in.
        """
        number = len(self.cases)
        steps = np.rint(prediction.logits[prediction.placement.window].astype(np.float64) / LOGIT_STEP)
        stored = np.clip(steps + LOGIT_ZERO, 0, 2**16 - 1).astype(np.uint16)
        self._archive.writestr(f"logits/{number:05d}.png", _png(stored))
        self._archive.writestr(f"masks/{number:05d}.png", _png(prediction.mask))
        height, width = prediction.mask.shape
        self.cases.append(
            {"case_id": prediction.case_id, "group": group, "part": part, "height": height, "width": width}
        )


@contextmanager
def writing(
    path: Path, preprocessing: Preprocessing, **about: str | int | None
) -> Iterator[PredictionWriter]:
    """Write a file of predictions; it appears under its name when all went well.

    Parameters
    ----------
    path : Path
        File to write.
    preprocessing : Preprocessing
        Preprocessing of the network.
    **about : str, int or None
        What else to keep: model, data set, fold, seed.

    Yields
    ------
    PredictionWriter
        Takes the cases.
    """
    with atomic_write(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        writer = PredictionWriter(archive)
        yield writer
        head = {"format": FORMAT, "version": VERSION, "logit_step": LOGIT_STEP, "logit_zero": LOGIT_ZERO}
        index = {**head, "preprocessing": dataclasses.asdict(preprocessing), **about, "cases": writer.cases}
        archive.writestr("index.json", json.dumps(index, indent=1), zipfile.ZIP_DEFLATED)


@dataclasses.dataclass(frozen=True)
class StoredPredictions:
    """Reader of a file of predictions; a case is decoded when it is asked for.

    Parameters
    ----------
    path : Path
        File that a run of ``study=segmentation`` left as ``predictions.zip``.
    about : mapping
        Content of ``index.json`` without the cases.
    cases : mapping of str to mapping
        ``group``, ``part``, ``height``, ``width`` and ``number`` of each case, by its id.
    """

    path: Path
    about: Mapping[str, Any]
    cases: Mapping[str, Mapping[str, Any]]

    @staticmethod
    def open(path: str | Path) -> StoredPredictions:
        """Read the index of a file.

        Parameters
        ----------
        path : str or Path
            The file.

        Returns
        -------
        StoredPredictions
            Its reader.

        Raises
        ------
        InputError
            If the file is missing, damaged or of another kind.
        """
        try:
            with zipfile.ZipFile(path) as archive:
                index = json.loads(archive.read("index.json"))
            if (index["format"], index["version"]) != (FORMAT, VERSION):
                raise KeyError(f"format {index['format']} of version {index['version']}")
            cases = {case["case_id"]: {**case, "number": n} for n, case in enumerate(index.pop("cases"))}
        except (OSError, zipfile.BadZipFile, KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{path}: expected predictions of study=segmentation, received none ({error})"
            ) from error
        return StoredPredictions(Path(path), index, cases)

    def of(self, part: str) -> tuple[str, ...]:
        """Return the cases of one part of the split.

        Parameters
        ----------
        part : str
            ``out_of_fold``, ``selection`` or ``held_out``.

        Returns
        -------
        tuple of str
            Ids in the order of the file.
        """
        return tuple(case for case, row in self.cases.items() if row["part"] == part)

    def logits(self, case_id: str) -> Float32[np.ndarray, "s s"]:
        """Read the logits of a case in the network's square.

        Parameters
        ----------
        case_id : str
            The case.

        Returns
        -------
        ndarray of float32, shape (s, s)
            Logits, to 1/128; minus infinity outside the frame.
        """
        preprocessing, row = self.preprocessing, self._row(case_id)
        size = preprocessing.image_size_px
        logits = np.full((size, size), -np.inf, dtype=np.float32)
        stored = self._picture("logits", row).astype(np.float32) - self.about["logit_zero"]
        window = preprocessing.placement(row["height"], row["width"]).window
        logits[window] = stored * np.float32(self.about["logit_step"])
        return logits

    def probability(self, case_id: str) -> Float32[np.ndarray, "h w"]:
        """Compute the probability of vessel at the frame's own size, as the predictor does.

        Parameters
        ----------
        case_id : str
            The case.

        Returns
        -------
        ndarray of float32, shape (h, w)
            Probabilities, 0 to 1, to 0.002.
        """
        import torch

        row, preprocessing = self._row(case_id), self.preprocessing
        maps = torch.sigmoid(torch.from_numpy(self.logits(case_id)))[None, None]
        placement = preprocessing.placement(row["height"], row["width"])
        probability: np.ndarray = preprocessing.restore(maps, placement)[0].numpy()
        return probability

    def mask(self, case_id: str) -> Bool[np.ndarray, "h w"]:
        """Read the mask of a case, thresholded at a probability of 0.5 before the logits were rounded.

        Parameters
        ----------
        case_id : str
            The case.

        Returns
        -------
        ndarray of bool, shape (h, w)
            Mask of the frame's own size.
        """
        return self._picture("masks", self._row(case_id)).astype(bool)

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the network."""
        from models.preprocessing.preprocessing import Preprocessing

        return Preprocessing(**self.about["preprocessing"])

    def _row(self, case_id: str) -> Mapping[str, Any]:
        if case_id not in self.cases:
            raise InputError(f"{self.path}: expected predictions of case {case_id!r}, found none")
        return self.cases[case_id]

    def _picture(self, kind: str, row: Mapping[str, Any]) -> np.ndarray:
        with zipfile.ZipFile(self.path) as archive:
            return np.asarray(Image.open(io.BytesIO(archive.read(f"{kind}/{row['number']:05d}.png"))))


class StoredMasks(Mapping[str, np.ndarray]):
    """Masks of a file of predictions by case, each decoded when it is asked for.

    Parameters
    ----------
    stored : StoredPredictions
        The file.
    """

    def __init__(self, stored: StoredPredictions) -> None:
        self._stored = stored

    def __getitem__(self, case_id: str) -> np.ndarray:
        return self._stored.mask(case_id)

    def __iter__(self) -> Iterator[str]:
        return iter(self._stored.cases)

    def __len__(self) -> int:
        return len(self._stored.cases)


def _png(picture: np.ndarray) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "png")
    return stream.getvalue()
