"""USGRA: in-vivo ultrasound of nerves and vessels in five body regions."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

from experiments.datasets.content_key import cached_while_unchanged
from experiments.datasets.images import image_files
from experiments.datasets.images.near_duplicates import near_duplicate_groups
from experiments.datasets.pairing import REFUSE, Pairing, pair, require_choice
from experiments.datasets.pixel_cache import read_pairs
from experiments.datasets.simulated import SimulatedSubstitute
from experiments.errors import InputError
from experiments.paths import PathSetting
from models.labelled_frames import LabelledFrames

LABELS = {"nerve": 1, "vessel": 2}


@dataclass(frozen=True)
class Usgra:
    """The 204 images of USGRA (tmkand/usgra-seg, CC BY 4.0) with the masks of one structure.

    Parameters
    ----------
    root : Path
        The folder of ``images`` and ``masks``.
    target : {'vessel', 'nerve'}
        The structure to segment.
    duplicate_correlation : float
        Similarity (see ``similarity_blocks``) above which two images are in one group; above 0 to 1.
    cache : str or None
        Folder for decoded pixels; None: they are not stored.
    simulate : bool
        Make ``substitute`` instead of reading.
    substitute : SimulatedSubstitute
        Settings of the simulated substitute.
    unpaired : {'refuse', 'skip'}
        Whether images without a mask and masks without an image are refused or left out.

    Raises
    ------
    InputError
        If a setting has another value than those above.

    Notes
    -----
    No subject is published, and more than a quarter of the images have a near-duplicate, many of them the
    same picture saved with another margin: groups are near-duplicates. No pixel spacing is known.
    """

    root: PathSetting
    target: str = "vessel"
    duplicate_correlation: float = 0.9
    cache: str | None = None
    simulate: bool = False
    substitute: SimulatedSubstitute = field(
        default_factory=lambda: SimulatedSubstitute(subjects=24, recordings=1, frames=4)
    )
    unpaired: str = REFUSE

    name: ClassVar[str] = "usgra"
    licence: ClassVar[str] = "CC BY 4.0"

    def __post_init__(self) -> None:
        if self.target not in LABELS:
            raise InputError(f"target: expected one of {', '.join(LABELS)}, received {self.target!r}")
        require_choice(self.unpaired)
        if not 0 < self.duplicate_correlation <= 1:
            raise InputError(
                f"duplicate_correlation: expected above 0 to 1, received {self.duplicate_correlation}"
            )
        if self.simulate and self.target != "vessel":
            raise InputError(f"target: expected vessel where simulate=true, received {self.target!r}")

    def require_root(self) -> Path | None:
        """Check that the folder is there.

        Returns
        -------
        Path or None
            The folder; None where the data set is simulated.

        Raises
        ------
        InputError
            If there is none; the message says where the data comes from.
        """
        return None if self.simulate else _folder(self)

    def __call__(self) -> LabelledFrames:
        """Read or simulate images and masks.

        Returns
        -------
        LabelledFrames
            All frames.

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
        return (
            "Subject leakage possible: no subjects are published; groups are images whose "
            f"thumbnails correlate above {self.duplicate_correlation:g}.",
            *(_paired(self).notes(_folder(self)) if Path(self.root).expanduser().is_dir() else ()),
        )

    def left_out(self) -> int:
        """Count the images and masks that were left out because they had no partner.

        Returns
        -------
        int
            Number of files.
        """
        return 0 if self.simulate else _paired(self).unpaired


def _folder(dataset: Usgra) -> Path:
    return image_files.require_root(
        dataset.name,
        dataset.root,
        "tmkand/usgra-seg, licence CC BY 4.0",
        "images/*.png with masks/*.png of the same names, 0 background, 1 nerve, 2 vessel",
    )


def _paired(dataset: Usgra) -> Pairing:
    root = _folder(dataset)
    folders = root / "images", root / "masks"
    images, masks = (image_files.image_files(folder) for folder in folders)
    others = [path for folder in folders for path in image_files.other_files(folder)]
    return pair(images, masks, others).settled(dataset.unpaired, root)


@cached_while_unchanged(lambda dataset: _paired(dataset).files)
def _read(dataset: Usgra) -> LabelledFrames:
    root = _folder(dataset)
    files = _paired(dataset).pairs
    vessel = {LABELS[dataset.target]}
    others = {0, *LABELS.values()} - vessel
    images, masks = read_pairs(
        [image for image, _ in files.values()],
        [mask for _, mask in files.values()],
        sorted(vessel),
        sorted(others),
        dataset.cache,
    )
    image_files.require_vessel(root / "masks", masks)
    groups = near_duplicate_groups(images, dataset.duplicate_correlation)
    return LabelledFrames(
        images=images,
        masks=masks,
        case_ids=tuple(files),
        groups=tuple(f"near_duplicates_{group:03d}" for group in groups),
        spacing_mm=(None,) * len(images),
        simulated=False,
    )


@lru_cache(maxsize=1)
def _simulated(dataset: Usgra) -> LabelledFrames:
    """Every subject another place of the body by another scanner; images are numbered through."""
    maker = dataset.substitute
    places = [(subject, number) for subject in range(maker.subjects) for number in range(maker.recordings)]
    made = maker([maker.recipe(subject, subject, sweep=number) for subject, number in places])
    rows = [
        (image, mask, f"near_duplicates_{subject:03d}", recorded.spacing_mm)
        for (subject, _), recorded in zip(places, made, strict=True)
        for image, mask in zip(recorded.images, recorded.masks, strict=True)
    ]
    images, masks, groups, spacing_mm = zip(*rows, strict=True)
    cases = tuple(f"{index:04d}" for index in range(len(rows)))
    return LabelledFrames(images, masks, cases, groups, spacing_mm, simulated=True)
