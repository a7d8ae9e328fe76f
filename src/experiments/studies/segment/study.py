"""Vessel masks of anyone's images, videos and sweeps, by a saved model."""

from __future__ import annotations

import json
import shutil
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image

from experiments import files
from experiments.errors import InputError
from experiments.inputs.paths import SweepReader, input_data, require_exists
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting
from experiments.studies.segment.kept_masks import KeptMasks
from experiments.studies.segment.overrides import overridden
from experiments.studies.segment.report import described_row, findings, overlay, record, row_of
from experiments.studies.segment.sources import NamedFrame, Source, sources_of
from models.errors import InputError as ModelInputError
from models.inference.engines import chosen_engine
from models.model_file import SegmentationModel
from models.predictor import Frame, Predictor
from registration.errors import InputError as RegistrationInputError

# Nothing is measured against a truth here: the tracker would only keep a second copy of all masks.
TRACKED = False
REFUSALS = (InputError, ModelInputError, RegistrationInputError)
OVERLAYS = "overlays"
Engine = Literal["auto", "eager", "compiled", "onnxruntime", "openvino"]


def check(*, model_path: PathSetting, input: PathSetting, out: str | None) -> None:
    """Check that the files exist and that results do not go among the images.

    Parameters
    ----------
    model_path : PathSetting
        File of a model.
    input : PathSetting
        Image, folder, video or tracked sweep.
    out : str or None
        Folder for the results.

    Raises
    ------
    InputError
        If a file is missing, there is nothing to segment, or ``out`` is the folder of the images or lies in it.
    """
    if not Path(model_path).expanduser().is_file():
        raise InputError(
            f"model_path: expected a model file or a network trained by study=segmentation (model.pt), received "
            f"{model_path!r}"
        )
    path = require_exists(input, "input")
    folder = (path if path.is_dir() else path.parent).resolve()
    results = None if out is None else Path(out).expanduser().resolve()
    inside = results is not None and (folder == results or (path.is_dir() and folder in results.parents))
    if inside:
        raise InputError(
            f"out: expected a folder apart from the input's, received {out!r} with input {input!r}"
        )
    sources_of(path)


def run(
    *,
    model_path: PathSetting,
    input: PathSetting,
    acquisition: SweepReader,
    spacing_mm: float | tuple[float, float] | None,
    threshold: float | None,
    low: float | None,
    high: float | None,
    relative: bool | None,
    min_peak: float | None,
    min_presence: float | None,
    min_area_px: float | None,
    min_area_mm2: float | None,
    fill_holes: bool | None,
    largest_only: bool | None,
    flips: bool | None,
    engine: Engine,
    device: Literal["cpu", "cuda"],
    batch_size: int,
    overlays: bool,
    resume: bool,
    out: str | None,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Segment every image, with masks of the images' names and sizes.

    Leaves a PNG file of 0 and 255 for each image in ``workspace``, in the input's subfolders, ``segmentation.json``
    and, if asked for, ``overlays``. An image that can't be read is left out and named; the others are done. A batch of
    frames is held at a time (all of a sweep or of a DICOM file).

    Parameters
    ----------
    model_path : PathSetting
        File of a model.
    input : PathSetting
        Image, folder, video or tracked sweep.
    acquisition : SweepReader
        Reader of tracked sweeps.
    spacing_mm : float, tuple of float or None
        Size of a pixel in mm, or vertical and horizontal; None for what DICOM files and sweeps say.
    threshold : float or None
        Plain threshold in place of the model's thresholds; None for these.
    low, high : float or None
        Thresholds of the hysteresis; None for the model's.
    relative : bool or None
        Whether they are shares of each image's highest probability; None for the model's.
    min_peak : float or None
        Highest probability below which a mask is empty; None for the model's.
    min_presence : float or None
        Probability of presence below which a mask is empty; None for the model's.
    min_area_px, min_area_mm2 : float or None
        Smallest area of a component; None for the model's.
    fill_holes : bool or None
        Whether holes are filled; None for the model's.
    largest_only : bool or None
        Whether only the largest component is kept; None for the model's.
    flips : bool or None
        Whether the mirror image counts too; None for the model's.
    engine : str
        What runs the networks.
    device : str
        ``cpu`` or ``cuda``.
    batch_size : int
        Number of frames that pass at a time.
    overlays : bool
        Whether pictures with the mask's outline are written.
    resume : bool
        Whether masks of the same images by the same model, from an earlier call, are taken.
    out : str or None
        Folder for the results.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each image, findings, and what could not be read.

    Raises
    ------
    InputError
        If a file is missing, no image can be read, or a setting is out of range.
    """
    check(model_path=model_path, input=input, out=out)
    settings = {
        "threshold": threshold,
        "low": low,
        "high": high,
        "relative": relative,
        "min_peak": min_peak,
        "min_presence": min_presence,
        "min_area_px": min_area_px,
        "min_area_mm2": min_area_mm2,
        "fill_holes": fill_holes,
        "largest_only": largest_only,
        "flips": flips,
    }
    model = overridden(SegmentationModel.load(Path(model_path).expanduser()), settings)
    spacing = _pair(spacing_mm)
    predictor = Predictor.from_model(model, batch_size, device, engine)
    work = _Work(predictor, KeptMasks.of(model.digest, spacing), resume, overlays, workspace)
    path = require_exists(input, "input")
    begin_s = time.perf_counter()
    rows = work.done(_frames(sources_of(path), acquisition, spacing, work.unreadable, progress))
    if not rows:
        raise InputError(f"input: expected images that can be read, found none ({work.unreadable[0]})")
    about = {
        "input": str(path),
        "model_path": str(model_path),
        "engine": chosen_engine(engine, device),
        "settings": {name: value for name, value in settings.items() if value is not None},
    }
    report = record(rows, work.unreadable, model, about, time.perf_counter() - begin_s)
    text = json.dumps(report, indent=1, allow_nan=False)
    files.write_text(workspace / "segmentation.json", text + "\n")
    return _outcome(report, Path(model_path).expanduser())


@dataclass(frozen=True)
class _Work:
    """Frames in, masks and rows out; frames whose mask is kept do not pass through the predictor."""

    predictor: Predictor
    kept: KeptMasks
    resume: bool
    overlays: bool
    workspace: Path
    unreadable: list[str] = field(default_factory=list)

    def done(self, frames: Iterator[NamedFrame]) -> list[dict[str, Any]]:
        rows: dict[int, dict[str, Any]] = {}
        waiting: deque[tuple[int, NamedFrame, Frame]] = deque()
        for found in self.predictor.stream(self._pending(frames, rows, waiting)):
            index, named, frame = waiting.popleft()
            row = row_of(frame, found)
            self.kept.write(named.key, found.mask, row)
            self._deliver(named, frame, found.mask)
            rows[index] = described_row(named, row, resumed=False)
        return [rows[index] for index in sorted(rows)]

    def _pending(
        self,
        frames: Iterator[NamedFrame],
        rows: dict[int, dict[str, Any]],
        waiting: deque[tuple[int, NamedFrame, Frame]],
    ) -> Iterator[Frame]:
        """The frames that have to be segmented; the others are delivered on the way."""
        used: set[str] = set()
        for index, given in enumerate(frames):
            named = _distinct(given, used)
            known = self.kept.row(named.key) if self.resume else None
            try:
                frame = named.read() if known is None or self.overlays else None
            except REFUSALS as refusal:
                self.unreadable.append(str(refusal))
                continue
            if known is not None:
                mask = np.asarray(Image.open(self.kept.mask_file(named.key))) > 0 if self.overlays else None
                self._deliver(named, frame, mask)
                rows[index] = described_row(named, known, resumed=True)
            elif frame is not None:
                waiting.append((index, named, frame))
                yield frame

    def _deliver(self, named: NamedFrame, frame: Frame | None, mask: np.ndarray | None) -> None:
        target = self.workspace / f"{named.name}.png"
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(self.kept.mask_file(named.key), target)
        if self.overlays and frame is not None and mask is not None:
            picture = self.workspace / OVERLAYS / f"{named.name}.png"
            picture.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(overlay(frame.grey, mask)).save(picture)


def _frames(
    sources: list[Source],
    acquisition: SweepReader,
    spacing_mm: tuple[float, float] | None,
    unreadable: list[str],
    progress: Progress,
) -> Iterator[NamedFrame]:
    """The frames of all sources; of one that can't be read on, the reason is noted and the next one follows."""
    several = len(sources) > 1
    for source in progress.track(sources, "images") if several else sources:
        frames = source.frames(acquisition, spacing_mm)
        try:
            yield from frames if several else progress.track(frames, "frames")
        except REFUSALS as refusal:
            unreadable.append(str(refusal))


def _distinct(frame: NamedFrame, used: set[str]) -> NamedFrame:
    """The frame under a name that no other has, on file systems without capital letters too."""
    name, number = frame.name, 2
    # A folder of overlays of the input's own is no place for ours.
    if name.split("/")[0].casefold() == OVERLAYS:
        name = f"input_{name}"
    start = name
    while name.casefold() in used:
        name, number = f"{start}_{number}", number + 1
    used.add(name.casefold())
    return NamedFrame(name, frame.key, frame.source, frame.number, frame.read)


def _pair(spacing_mm: float | tuple[float, float] | None) -> tuple[float, float] | None:
    if spacing_mm is None:
        return None
    sides = (spacing_mm, spacing_mm) if isinstance(spacing_mm, (int, float)) else tuple(spacing_mm)
    if len(sides) != 2 or not all(0 < side < float("inf") for side in sides):
        raise InputError(f"spacing_mm: expected one or two positive numbers, received {spacing_mm}")
    return float(sides[0]), float(sides[1])


def _outcome(report: Mapping[str, Any], model_path: Path) -> Outcome:
    import pandas as pd

    numbers = {name: float(value) for name, value in report["totals"].items() if value is not None}
    return Outcome(
        metrics=numbers,
        cases=pd.DataFrame(report["images"]).drop(columns=["spacing_mm"]),
        findings=findings(report),
        tags={"model_digest": report["model"]["digest"][:16]},
        inputs=(input_data(model_path),),
        refused=tuple(report["unreadable"]),
    )
