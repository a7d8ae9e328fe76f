"""Mus-V: arteries and veins of neck and groin in ultrasound videos."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from experiments.datasets.content_key import cached_while_unchanged
from experiments.datasets.images import image_files
from experiments.datasets.musv_subjects import ALL, DISTRICTS, Volunteer, read_volunteers
from experiments.datasets.pairing import REFUSE, Pairing, pair, require_choice
from experiments.datasets.pixel_cache import read_pairs
from experiments.datasets.simulated import SimulatedSubstitute, variation_note
from experiments.datasets.sweep_cache import SweepRecipe
from experiments.errors import InputError
from experiments.paths import PathSetting
from experiments.unicode_names import same_name
from models.labelled_frames import LabelledFrames

LABELS = {"vein": 1, "artery": 2}
PARTS = ("train", "valid")
VIDEOS, ANNOTATIONS = "Videos", "Annotations"


@dataclass(frozen=True)
class MusV:
    """Mus-V (multi-stage ultrasound vessel segmentation, CC BY-NC): 3114 frames of 105 sequences.

    Frames have several sizes and no known pixel spacing. The published parts ``train`` and ``valid`` are
    taken together; forces are not read.

    Parameters
    ----------
    root : Path
        The folder of ``Videos`` and ``Annotations``.
    target : {'artery', 'vein'}
        The vessel to segment.
    district : {'all', 'carotid', 'femoral'}
        The part of the body; all, where there is no table ``subjects``.
    subjects : Path or None
        CSV with columns seq, volunteer, district. Its volunteers are the groups; None: sequences are, and
        then a volunteer may be on both sides of a split.
    simulate : bool
        Make ``substitute`` instead of reading.
    substitute : SimulatedSubstitute
        Settings of the simulated substitute: both vessels next to each other, in both districts of each
        subject.
    cache : str or None
        Folder for decoded pixels; None: they are not stored.
    unpaired : {'refuse', 'skip'}
        Whether images without a mask and masks without an image are refused or left out.

    Raises
    ------
    InputError
        If a setting has another value than those above, or a district is given without a table.
    """

    root: PathSetting
    target: str
    district: str = ALL
    subjects: PathSetting | None = None
    simulate: bool = False
    substitute: SimulatedSubstitute = field(default_factory=SimulatedSubstitute)
    cache: str | None = None
    unpaired: str = REFUSE

    def __post_init__(self) -> None:
        require_choice(self.unpaired)
        if self.target not in LABELS:
            raise InputError(f"target: expected one of {', '.join(sorted(LABELS))}, received {self.target!r}")
        if self.district not in (ALL, *DISTRICTS):
            raise InputError(
                f"district: expected one of {', '.join((ALL, *DISTRICTS))}, received {self.district!r}"
            )
        if self.district != ALL and self.subjects is None and not self.simulate:
            raise InputError(
                f"district: expected {ALL} where no table says what a sequence shows, received {self.district!r}; "
                f"pass dataset.subjects=<CSV with columns seq, volunteer, district>"
            )

    @property
    def name(self) -> str:
        """What tables call it: the vessel, and the district where it is one alone."""
        return f"musv_{self.target}" + ("" if self.district == ALL else f"_{self.district}")

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
        """Read or simulate images and masks by sequence.

        Returns
        -------
        LabelledFrames
            All frames of the district.

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
            recipes = _recipes(self.substitute, _chosen(self)).values()
            return (self.substitute.note("Mus-V"), variation_note(tuple(recipes)))
        notes = (
            "Subject leakage possible: groups are sequences, and no table says whose they are."
            if self.subjects is None
            else f"Groups are the volunteers of {Path(self.subjects).name}.",
        )
        if not Path(self.root).expanduser().is_dir():
            return notes
        return (*notes, *_paired(self)[0].notes(_folder(self)))

    def districts(self, cases: Sequence[str]) -> tuple[str, ...]:
        """Look up the part of the body that each case shows.

        Parameters
        ----------
        cases : sequence of str
            Names of cases.

        Returns
        -------
        tuple of str
            ``carotid`` or ``femoral`` for each case; empty where no table says it.
        """
        sequences = [case.rpartition("_")[0] for case in cases]
        if self.simulate:
            places = _places(self.substitute)
            return tuple(places[sequence][1] for sequence in sequences)
        if self.subjects is None:
            return ("",) * len(cases)
        known = read_volunteers(Path(self.subjects), sequences)
        return tuple(known[sequence].district for sequence in sequences)

    def left_out(self) -> int:
        """Count the images and masks that were left out because they had no partner.

        Returns
        -------
        int
            Number of files.
        """
        return 0 if self.simulate else _paired(self)[0].unpaired


def _folder(dataset: MusV) -> Path:
    return image_files.require_root(
        dataset.name,
        dataset.root,
        "Mus-V, multi-stage ultrasound vessel segmentation, licence CC BY-NC",
        f"{VIDEOS}/train and {VIDEOS}/valid with <seq>/<seq>_<fff>.png, {ANNOTATIONS}/<seq>/ with masks of the same "
        f"names, 0 background, 1 vein, 2 artery",
    )


def _files(dataset: MusV) -> tuple[Path, ...]:
    table = () if dataset.subjects is None else (Path(dataset.subjects).expanduser(),)
    return (*_paired(dataset)[0].files, *table)


@cached_while_unchanged(_files)
def _read(dataset: MusV) -> LabelledFrames:
    root = _folder(dataset)
    pairing, groups = _paired(dataset)
    files = pairing.pairs
    vessel = LABELS[dataset.target]
    images, shown = read_pairs(
        [image for image, _ in files.values()],
        [mask for _, mask in files.values()],
        (vessel,),
        tuple({0, *LABELS.values()} - {vessel}),
        dataset.cache,
    )
    image_files.require_vessel(root / ANNOTATIONS, shown)
    return LabelledFrames(images, shown, tuple(files), groups, (None,) * len(files), simulated=False)


def _paired(dataset: MusV) -> tuple[Pairing, tuple[str, ...]]:
    """Image and mask of each case, and the group of each."""
    root = _folder(dataset)
    videos, annotations = _sequences(root), _annotations(root)
    known = read_volunteers(Path(dataset.subjects), videos) if dataset.subjects else None
    found, groups = Pairing({}), []
    for sequence, folder in _of_district(videos, known, dataset.district).items():
        masks = image_files.image_files(annotations[sequence]) if sequence in annotations else {}
        others = [
            path
            for one in (folder, annotations.get(sequence))
            if one
            for path in image_files.other_files(one)
        ]
        part = pair(_frames(sequence, folder), masks, others)
        groups += [known[sequence].name if known else sequence] * len(part.pairs)
        found += part
    alone = [folder for sequence, folder in annotations.items() if sequence not in videos]
    found += Pairing(
        {}, masks=tuple(path for folder in alone for path in image_files.image_files(folder).values())
    )
    return found.settled(dataset.unpaired, root), tuple(groups)


def _sequences(root: Path) -> dict[str, Path]:
    """Return the folder of each sequence, in order of name; each must be in one part."""
    found: dict[str, Path] = {}
    for part in PARTS:
        folder = root / VIDEOS / part
        if not folder.is_dir():
            raise InputError(f"{folder}: expected a folder of sequences, found none")
        for sequence in folder.iterdir():
            if not sequence.is_dir():
                continue
            name = same_name(sequence.name)
            if name in found:
                raise InputError(
                    f"{sequence}: expected a sequence in one part, found it in {found[name]} too"
                )
            found[name] = sequence
    if not found:
        raise InputError(f"{root / VIDEOS}: expected sequences in {' and '.join(PARTS)}, found none")
    return dict(sorted(found.items()))


def _annotations(root: Path) -> dict[str, Path]:
    """Return the folders of masks that hold any file, by sequence."""
    folder = root / ANNOTATIONS
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder of annotations, found none")
    return {
        same_name(one.name): one for one in sorted(folder.iterdir()) if one.is_dir() and any(one.iterdir())
    }


def _of_district(
    videos: Mapping[str, Path], known: Mapping[str, Volunteer] | None, district: str
) -> Mapping[str, Path]:
    if district == ALL or known is None:
        return videos
    chosen = {seq: folder for seq, folder in videos.items() if known[seq].district == district}
    if not chosen:
        raise InputError(f"district: expected sequences of district {district} in the table, found none")
    return chosen


def _frames(sequence: str, folder: Path) -> dict[str, Path]:
    """Return the frames of a sequence in order of their number."""
    files = image_files.image_files(folder)
    numbered = re.compile(rf"{re.escape(sequence)}_(\d+)")
    for case, path in files.items():
        if not numbered.fullmatch(case):
            raise InputError(f"{path}: expected a name {sequence}_<number>, received {case!r}")
    return dict(sorted(files.items(), key=lambda item: int(item[0].rpartition("_")[2])))


def _places(maker: SimulatedSubstitute) -> dict[str, tuple[int, str]]:
    """Subject and district of each simulated sequence; sequences are numbered through."""
    places = [
        (subject, district)
        for subject in range(maker.subjects)
        for district in DISTRICTS
        for _ in range(maker.recordings)
    ]
    return {f"{1 + index:03d}": place for index, place in enumerate(places)}


def _chosen(dataset: MusV) -> dict[str, tuple[int, str]]:
    places = _places(dataset.substitute)
    return {seq: place for seq, place in places.items() if dataset.district in (ALL, place[1])}


def _recipes(maker: SimulatedSubstitute, chosen: Mapping[str, tuple[int, str]]) -> dict[str, SweepRecipe]:
    return {seq: maker.recipe(place[0], int(seq), district=place[1]) for seq, place in chosen.items()}


@lru_cache(maxsize=1)
def _simulated(dataset: MusV) -> LabelledFrames:
    """Each subject recorded as often as the settings say in each district."""
    chosen = _chosen(dataset)
    made = dataset.substitute(tuple(_recipes(dataset.substitute, chosen).values()))
    label = LABELS[dataset.target]
    rows = [
        (image, labels == label, f"{seq}_{frame:03d}", f"volunteer_{place[0] + 1:02d}", recorded.spacing_mm)
        for (seq, place), recorded in zip(chosen.items(), made, strict=True)
        for frame, (image, labels) in enumerate(zip(recorded.images, recorded.masks, strict=True))
    ]
    images, masks, cases, groups, spacing_mm = zip(*rows, strict=True)
    return LabelledFrames(images, masks, cases, groups, spacing_mm, simulated=True)
