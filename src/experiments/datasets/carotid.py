"""Common Carotid Artery Ultrasound Images: the artery across, outlined by experts."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

from experiments.datasets.content_key import cached_while_unchanged
from experiments.datasets.images import image_files
from experiments.datasets.pairing import REFUSE, Pairing, pair, require_choice
from experiments.datasets.pixel_cache import read_pairs
from experiments.datasets.simulated import SimulatedSubstitute
from experiments.errors import InputError
from experiments.paths import PathSetting
from models.labelled_frames import LabelledFrames

FOLDER, IMAGES, MASKS = "Common Carotid Artery Ultrasound Images", "US images", "Expert mask images"
PATTERN = re.compile(
    r"(?P<recording>(?P<time>\d{14})(?P<serial>\d{4}) ?(VAS|EM VASCULAR))_slice_(?P<frame>\d+)"
)
SUBJECT, RECORDING = "subject", "recording"
IMAGES_A_SUBJECT = 100


@dataclass(frozen=True)
class Carotid:
    """Common Carotid Artery Ultrasound Images (A. Momot, Mendeley Data, doi 10.17632/d4xt63mgjm, CC BY 4.0).

    1100 images of 709x749 pixels with masks 0 and 255. No pixel spacing and no subject is published.

    Parameters
    ----------
    root : Path
        The folder that holds ``US images`` and ``Expert mask images``, or the one around it.
    group_by : {'subject', 'recording'}
        ``subject`` builds groups from the published "100 images a person": recordings are added up in order
        of time until each hundred is full. This gives 11 groups, the last of them smaller in an incomplete
        copy.
    simulate : bool
        Make ``substitute`` instead of reading.
    substitute : SimulatedSubstitute
        Settings of the simulated substitute.
    cache : str or None
        Folder for decoded pixels; None: they are not stored.
    unpaired : {'refuse', 'skip'}
        Whether images without a mask and masks without an image are refused or left out.

    Raises
    ------
    InputError
        If a setting has another value than those above.
    """

    root: PathSetting
    group_by: str = SUBJECT
    simulate: bool = False
    substitute: SimulatedSubstitute = field(
        default_factory=lambda: SimulatedSubstitute(subjects=11, strength=0.3)
    )
    cache: str | None = None
    unpaired: str = REFUSE

    name: ClassVar[str] = "carotid"
    licence: ClassVar[str] = "CC BY 4.0"

    def __post_init__(self) -> None:
        if self.group_by not in (SUBJECT, RECORDING):
            raise InputError(f"group_by: expected {SUBJECT} or {RECORDING}, received {self.group_by!r}")
        require_choice(self.unpaired)

    def require_root(self) -> Path | None:
        """Check that the folder is there.

        Returns
        -------
        Path or None
            The folder that holds images and masks; None where the data set is simulated.

        Raises
        ------
        InputError
            If there is none; the message says where the data comes from.
        """
        return None if self.simulate else _folder(self)

    def __call__(self) -> LabelledFrames:
        """Read or simulate images and masks in order of time.

        Returns
        -------
        LabelledFrames
            All frames, grouped by subject or recording.

        Raises
        ------
        InputError
            If a file or folder is not as expected; the message names it.
        """
        return _simulated(self) if self.simulate else _read(self)

    def notes(self) -> tuple[str, ...]:
        """Return what a reader of the results must know of the data.

        Returns
        -------
        tuple of str
            Sentences on the groups and on what was left out.
        """
        if self.simulate:
            return (self.substitute.note(self.name),)
        left_out = self._left_out_notes()
        if self.group_by == RECORDING:
            return (
                "Subject leakage possible: groups are recordings, and a subject has several.",
                *left_out,
            )
        return (
            "Groups are built, not published: recordings in order of time, added up to 100 images a subject.",
            *left_out,
        )

    def left_out(self) -> int:
        """Count the images and masks that were left out because they had no partner.

        Returns
        -------
        int
            Number of files.
        """
        return 0 if self.simulate else _paired(self)[0].unpaired

    def _left_out_notes(self) -> tuple[str, ...]:
        if not Path(self.root).expanduser().is_dir():
            return ()
        pairing, counts = _paired(self)
        notes = pairing.notes(_folder(self))
        partial = "" if self.group_by == RECORDING else last_subject(counts)
        return (*notes, f"The copy is not whole: {partial}.") if partial else notes


def subject_groups(counts: Mapping[str, int]) -> dict[str, str]:
    """Assign recordings to subjects, in order of name and so of time, until each hundred of images is full.

    Parameters
    ----------
    counts : mapping of str to int
        Number of images of each recording.

    Returns
    -------
    dict of str to str
        The subject group of each recording; the last subject may have fewer images.

    Raises
    ------
    InputError
        If a recording would belong to two subjects.
    """
    groups: dict[str, str] = {}
    subject, filled = 1, 0
    for recording in sorted(counts):
        filled += counts[recording]
        groups[recording] = f"subject_{subject:02d}"
        if filled > IMAGES_A_SUBJECT:
            raise _not_hundreds(f"{filled} with recording {recording!r}, for subject {subject}")
        if filled == IMAGES_A_SUBJECT:
            subject, filled = subject + 1, 0
    return groups


def last_subject(counts: Mapping[str, int]) -> str:
    """Describe a last subject that has fewer images than the others.

    Parameters
    ----------
    counts : mapping of str to int
        Number of images of each recording.

    Returns
    -------
    str
        Part of a sentence; empty where the last subject has as many images as the others.
    """
    left = sum(counts.values()) % IMAGES_A_SUBJECT
    if not left:
        return ""
    number = sum(counts.values()) // IMAGES_A_SUBJECT + 1
    return f"its last subject, subject_{number:02d}, has {left} of {IMAGES_A_SUBJECT} images"


def _not_hundreds(found: str) -> InputError:
    return InputError(
        f"group_by: expected recordings that add up to {IMAGES_A_SUBJECT} images for each subject in order of time, "
        f"received {found}; pass dataset.group_by={RECORDING} to take each recording for a group"
    )


def _folder(dataset: Carotid) -> Path:
    around = Path(dataset.root).expanduser() / FOLDER
    return image_files.require_root(
        dataset.name,
        around if around.is_dir() else dataset.root,
        "Common Carotid Artery Ultrasound Images by A. Momot, Mendeley Data d4xt63mgjm, licence CC BY 4.0",
        f"{FOLDER}/{IMAGES}/*.png with {FOLDER}/{MASKS}/*.png of the same names, 0 background, 255 artery",
    )


@cached_while_unchanged(lambda dataset: _paired(dataset)[0].files)
def _read(dataset: Carotid) -> LabelledFrames:
    folder = _folder(dataset)
    pairing, counts = _paired(dataset)
    parts = {case: _parts(path) for case, (path, _) in pairing.pairs.items()}
    cases = sorted(parts, key=parts.__getitem__)
    recordings = [parts[case][0] for case in cases]
    # Groups first: names that do not add up should be refused before half a minute of reading.
    groups = _groups(dataset.group_by, recordings, counts)
    files = [pairing.pairs[case] for case in cases]
    images, masks = read_pairs(
        [image for image, _ in files], [mask for _, mask in files], (255,), (0,), dataset.cache
    )
    image_files.require_vessel(folder / MASKS, masks)
    return LabelledFrames(images, masks, tuple(cases), groups, (None,) * len(cases), simulated=False)


def _paired(dataset: Carotid) -> tuple[Pairing, Counter[str]]:
    """Image and mask of each case, and how many images each recording had before any was lost."""
    folder = _folder(dataset)
    images, masks = image_files.image_files(folder / IMAGES), image_files.image_files(folder / MASKS)
    others = (*image_files.other_files(folder / IMAGES), *image_files.other_files(folder / MASKS))
    # An image whose mask was lost, or a mask whose image was, still fills its subject's hundred.
    frames = [found for name in {*images, *masks} if (found := PATTERN.fullmatch(name))]
    counts = Counter(found["recording"] for found in frames)
    partial = "" if dataset.group_by == RECORDING else last_subject(counts)
    pairing = pair(images, masks, others)
    return pairing.settled(dataset.unpaired, folder, f"; {partial}" if partial else ""), counts


def _parts(path: Path) -> tuple[str, int]:
    """Return the recording that an image is from, and its place in it."""
    found = PATTERN.fullmatch(path.stem)
    if found is None:
        raise InputError(
            f"{path}: expected a name YYYYMMDDhhmmss, four digits, VAS or EM VASCULAR, _slice_ and a number, "
            f"received {path.stem!r}"
        )
    return found["recording"], int(found["frame"])


def _groups(group_by: str, recordings: Sequence[str], counts: Mapping[str, int]) -> tuple[str, ...]:
    if group_by == RECORDING:
        return tuple(recordings)
    subjects = subject_groups(counts)
    return tuple(subjects[recording] for recording in recordings)


@lru_cache(maxsize=1)
def _simulated(dataset: Carotid) -> LabelledFrames:
    """Subjects one day apart, each recorded as often as the settings say by one scanner in one state."""
    maker = dataset.substitute
    places = [(subject, number) for subject in range(maker.subjects) for number in range(maker.recordings)]
    made = maker([maker.recipe(subject, subject, sweep=number) for subject, number in places])
    rows = [
        (image, mask, f"{recording}_slice_{frame}", group, recorded.spacing_mm)
        for (subject, number), recorded in zip(places, made, strict=True)
        for recording, group in [_simulated_names(dataset, subject, number)]
        for frame, (image, mask) in enumerate(zip(recorded.images, recorded.masks, strict=True))
    ]
    images, masks, cases, groups, spacing_mm = zip(*rows, strict=True)
    return LabelledFrames(images, masks, cases, groups, spacing_mm, simulated=True)


def _simulated_names(dataset: Carotid, subject: int, number: int) -> tuple[str, str]:
    """Return recording and group of a subject's recording, as the real set names them, in the year 2000."""
    time = datetime(2000, 1, 1, 10) + timedelta(days=subject, minutes=5 * number)
    kind = "VAS" if number % 2 == 0 else "EM VASCULAR"
    recording = f"{time:%Y%m%d%H%M%S}{number + 1:04d}{kind}"
    return recording, f"subject_{subject + 1:02d}" if dataset.group_by == SUBJECT else recording
