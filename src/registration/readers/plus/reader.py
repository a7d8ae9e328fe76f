"""Tracked sweeps from sequence files of the PLUS toolkit (``.igs.mha`` and ``.igs.nrrd``)."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.errors import InputError
from registration.input_files import refusing
from registration.readers.chain.graph import TransformGraph
from registration.readers.plus.calibration import (
    ImagePlacement,
    image_placement,
    known_frames,
    poses,
    recorded_links,
)
from registration.readers.plus.config import read_device_set
from registration.readers.plus.fields import CLOCKS, ambiguous_names, frame_times_s, read_sequence
from registration.readers.plus.sequence import PlusSequence
from registration.readers.streams.checks import as_grey, distinct_times
from registration.sweep import ProbeCalibration, TrackedSweep


@dataclass(frozen=True)
class PlusReader:
    """Read a tracked sweep from a PLUS sequence file.

    The poses are the chain from ``ee`` to ``world`` through the transforms that each frame carries, the
    calibration is the chain from ``image`` to ``ee`` through those and the coordinate definitions of
    ``device_set``. What the device set states of the calibration comes before what the file states; of poses,
    what was tracked comes first. Contradictions are in the sweep's ``notes``. Frames with
    ``ImageToCroppedImageTransform`` were cropped: their pixels are those of CroppedImage. A calibration that
    changes from frame to frame is kept for each frame. The tracked marker on the probe, which PLUS calls
    Probe, is the end effector; ``ee_T_probe`` is the identity. Without image pixels the sweep has poses only,
    and needs no calibration.

    Parameters
    ----------
    world : str, optional
        PLUS's name of the world.
    ee : str, optional
        PLUS's name of the end effector.
    image : str, optional
        PLUS's name of the image.
    device_set : str or Path, optional
        XML file of the device set, or a ``.results.xml`` of a calibration; None takes the recording's
        transforms alone.
    tracker : str or Path, optional
        Second sequence with the poses, recorded next to a video.
    clock : {'filtered', 'unfiltered'}, optional
        Which of two recorded times counts.
    orientation : str, optional
        Orientation in place of the file's.
    rigid_tolerance : float, optional
        How far poses may be off orthonormal (no unit); they are brought to the nearest rotation.
    uncalibrated : bool, optional
        True where no calibration is known yet, as for a temporal calibration: pixels then stand for
        millimetres.

    Raises
    ------
    InputError
        If a setting is not what it must be.
    """

    world: str = "Reference"
    ee: str = "Probe"
    image: str = "Image"
    device_set: str | Path | None = None
    tracker: str | Path | None = None
    clock: str = "filtered"
    orientation: str | None = None
    rigid_tolerance: float = transforms.RIGID_TOLERANCE
    uncalibrated: bool = False

    def __post_init__(self) -> None:
        if self.clock not in CLOCKS:
            raise InputError(f"clock: expected {' or '.join(CLOCKS)}, received {self.clock!r}")
        if not self.rigid_tolerance > 0:
            raise InputError(f"rigid_tolerance: expected a number above 0, received {self.rigid_tolerance!r}")

    def __call__(self, path: Path) -> TrackedSweep:
        """Read a sweep; frames with an INVALID image or pose are left out and counted by reason.

        Parameters
        ----------
        path : Path
            Sequence file.

        Returns
        -------
        TrackedSweep
            Frames and poses as recorded.

        Raises
        ------
        InputError
            If nothing valid is left or the calibration cannot be found.
        """
        video = read_sequence(path, self.orientation)
        tracker_path = path if self.tracker is None else Path(self.tracker)
        tracked = video if self.tracker is None else read_sequence(tracker_path)
        defined = (
            TransformGraph({})
            if self.device_set is None
            else read_device_set(Path(self.device_set)).transforms
        )
        world_T_ee, pose_reasons, notes = self._poses(tracked, defined, tracker_path)
        placed = self._placement(video, defined, path)
        image_reasons = _image_reasons(video)
        dropped: Counter[str] = Counter()
        if self.tracker is None:
            image_reasons = np.where(image_reasons == "", pose_reasons, image_reasons)
        else:
            dropped.update(f"pose: {reason}" for reason in pose_reasons[pose_reasons != ""])
        image_reasons = np.where(image_reasons == "", placed.reasons, image_reasons)
        dropped.update(image_reasons[image_reasons != ""].tolist())
        valid_pose, keep = pose_reasons == "", image_reasons == ""
        pose_times_s, world_T_ee = distinct_times(
            frame_times_s(tracked, self.clock, str(tracker_path))[valid_pose],
            world_T_ee[valid_pose],
            str(tracker_path),
        )
        keep = keep & (not video.tracker_only)
        with refusing(path, "a tracked sweep"):
            return TrackedSweep(
                images=as_grey(video.pixels[keep], str(path)),
                image_times_s=frame_times_s(video, self.clock, str(path))[keep],
                world_T_ee=world_T_ee,
                pose_times_s=pose_times_s,
                calibration=ProbeCalibration(ee_T_probe=np.eye(4), probe_A_pixel=placed.ee_A_pixel),
                dropped=dict(dropped),
                notes=(*notes, *placed.notes),
                image_A_pixel=None if placed.image_A_pixel is None else placed.image_A_pixel[keep],
            )

    def _poses(
        self, sequence: PlusSequence, defined: TransformGraph, path: Path
    ) -> tuple[Float64[np.ndarray, "n 4 4"], np.ndarray, tuple[str, ...]]:
        """The pose of every frame, why it has none (n,), empty where it has one, and what contradicts the poses."""
        links = recorded_links(sequence, defined, self._known, path)
        try:
            rigid, reasons, notes = poses(links, self.ee, self.world, len(sequence.frame_fields), path)
        except InputError as failure:
            unclear = ambiguous_names(sequence, known_frames(defined, self._known))
            several = f" ({', '.join(unclear)} could link several pairs of frames)" if unclear else ""
            raise InputError(f"{failure}{several}") from failure
        if (reasons != "").all():
            raise InputError(
                f"{path}: expected at least one frame with a valid {self.ee}To{self.world}, found none"
            )
        name = f"{path}: {self.ee}To{self.world}"
        transforms.require_rigid(rigid[reasons == ""], name, self.rigid_tolerance)
        return transforms.nearest_rigid(rigid), reasons, notes

    def _placement(self, video: PlusSequence, defined: TransformGraph, path: Path) -> ImagePlacement:
        """From pixels to the tracked marker; millimetres where there are no pixels or no calibration is wanted."""
        none = ImagePlacement(np.eye(4), None, np.full(len(video.frame_fields), "", dtype="U96"), ())
        if self.uncalibrated:
            return none
        links = recorded_links(video, defined, self._known, path)
        try:
            return image_placement(links, self.image, self.ee, video, path)
        except InputError as failure:
            if video.tracker_only:
                return none
            raise InputError(
                f"{path}: no calibration (set device_set, or uncalibrated=true where none is needed): {failure}"
            ) from failure

    @property
    def _known(self) -> tuple[str, ...]:
        return (self.world, self.ee, self.image)


def _image_reasons(video: PlusSequence) -> np.ndarray:
    statuses = [fields.get("ImageStatus", "OK") for fields in video.frame_fields]
    if video.tracker_only:
        return np.full(len(statuses), "", dtype="U96")
    return np.array(["" if status == "OK" else f"ImageStatus {status}" for status in statuses], dtype="U96")
