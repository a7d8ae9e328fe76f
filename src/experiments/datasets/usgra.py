"""USGRA: in-vivo ultrasound of nerves and vessels in five body regions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

from experiments.datasets import reading
from experiments.datasets.twins import twin_groups
from experiments.errors import InputError
from models.labelled_frames import LabelledFrames

LABELS = {"nerve": 1, "vessel": 2}


@dataclass(frozen=True)
class Usgra:
    """The 204 images of USGRA (tmkand/usgra-seg, CC BY 4.0) with the masks of one ``target``, vessel or nerve.

    No subject is published, and a fifth of the images have a near twin: images whose 48x48 thumbnails correlate above
    ``twin_correlation`` form one group. No pixel spacing is known. Images load once in a process.
    """

    root: str
    target: str = "vessel"
    twin_correlation: float = 0.9

    name: ClassVar[str] = "usgra"

    def __post_init__(self) -> None:
        if self.target not in LABELS:
            raise InputError(f"target: expected one of {', '.join(LABELS)}, received {self.target!r}")
        if not 0 < self.twin_correlation <= 1:
            raise InputError(f"twin_correlation: expected above 0 to 1, received {self.twin_correlation}")

    def require_root(self) -> Path:
        """The folder; InputError says where the data comes from if it is not there."""
        return reading.require_root(
            self.name,
            self.root,
            "tmkand/usgra-seg, licence CC BY 4.0",
            "images/*.png with masks/*.png of the same names, 0 background, 1 nerve, 2 vessel",
        )

    def __call__(self) -> LabelledFrames:
        """Read the images and masks; InputError names the folder or file that is not as expected."""
        return _read(self)


@lru_cache(maxsize=1)
def _read(dataset: Usgra) -> LabelledFrames:
    root = dataset.require_root()
    files, mask_files = reading.image_files(root / "images"), reading.image_files(root / "masks")
    reading.paired(files, mask_files)
    vessel = {LABELS[dataset.target]}
    others = {0, *LABELS.values()} - vessel
    images = tuple(reading.read_grey(path) for path in files.values())
    masks = tuple(
        reading.read_mask(mask_files[name], vessel, others, image.shape)
        for name, image in zip(files, images, strict=True)
    )
    reading.require_vessel(root / "masks", masks)
    groups = twin_groups(images, dataset.twin_correlation)
    return LabelledFrames(
        images=images,
        masks=masks,
        case_ids=tuple(files),
        groups=tuple(f"twins_{group:03d}" for group in groups),
        spacing_mm=(None,) * len(images),
        simulated=False,
    )
