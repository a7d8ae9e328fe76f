"""Where the frames to segment come from: image files, folders of them, videos and tracked sweeps, read as asked for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments import files
from experiments.datasets.images.dicom import is_dicom, read_dicom
from experiments.datasets.images.image_files import IMAGE_SUFFIXES, read_grey
from experiments.errors import InputError, reading
from experiments.inputs.paths import SweepReader, input_data
from models.predictor import Frame
from registration.input_files import require_regular
from registration.natural_order import natural_key
from registration.readers.folder import frame_names
from registration.readers.plus.fields import SUFFIXES as SEQUENCES
from registration.readers.rosbag.bags import METADATA
from registration.readers.rosbag.bags import SUFFIXES as BAGS

VIDEOS = (".mp4", ".m4v", ".avi", ".mov", ".mkv", ".webm", ".wmv", ".mpg", ".mpeg", ".gif")
INSTALL_VIDEO = "pip install 'ctus[video]'"


@dataclass(frozen=True)
class NamedFrame:
    """A frame to segment, not read yet.

    Parameters
    ----------
    name : str
        Name of its mask without suffix, with ``/`` between folders.
    key : str
        What the frame is, by content: digest of its file and its number there.
    source : str
        File that it is from.
    number : int
        Its number there, from 0.
    read : callable
        Reads the frame.
    """

    name: str
    key: str
    source: str
    number: int
    read: Callable[[], Frame]


@dataclass(frozen=True)
class Source:
    """A file, or a sweep, that frames come from.

    Parameters
    ----------
    path : Path
        Where it lies.
    name : str
        Name of its mask, or the beginning of its masks' names.
    kind : str
        ``image``, ``dicom``, ``video`` or ``sweep``.
    """

    path: Path
    name: str
    kind: str

    def frames(
        self, acquisition: SweepReader, spacing_mm: tuple[float, float] | None
    ) -> Iterator[NamedFrame]:
        """List the frames; those of a video are decoded one after the other.

        Parameters
        ----------
        acquisition : SweepReader
            Reader of sweeps.
        spacing_mm : tuple of float or None
            Size of all pixels in mm (vertical, horizontal); None for what the files say.

        Yields
        ------
        NamedFrame
            The frames in order.

        Raises
        ------
        InputError
            If the source can't be read.
        """
        digest = input_data(self.path).digest if self.kind == "sweep" else files.digest(self.path)
        if self.kind == "image":
            yield self._frame(self.name, digest, 0, lambda: Frame(read_grey(self.path), spacing_mm))
        elif self.kind == "video":
            for number, image in enumerate(read_video(self.path)):
                yield self._frame(f"{self.name}_{number:05d}", digest, number, _given(image, spacing_mm))
        else:
            images, own_mm, names = self._stack(acquisition)
            for number, (name, image) in enumerate(zip(names, images, strict=True)):
                yield self._frame(name, digest, number, _given(image, spacing_mm or own_mm))

    def _stack(
        self, acquisition: SweepReader
    ) -> tuple[np.ndarray, tuple[float, float] | None, Sequence[str]]:
        """All frames of a sweep or of a DICOM file, their pixel size and their names."""
        if self.kind == "dicom":
            read = read_dicom(self.path)
            one = len(read.images) == 1
            names = [self.name] if one else [f"{self.name}_{n:05d}" for n in range(len(read.images))]
            return read.images, read.spacing_mm, names
        sweep = acquisition(self.path)
        known = frame_names(self.path)
        numbered = [f"{self.name}_{number:05d}" for number in range(len(sweep.images))]
        own = known is not None and len(known) == len(sweep.images) and len(set(known)) == len(known)
        spacing_mm = sweep.calibration.spacing_mm
        return (
            sweep.images,
            (float(spacing_mm[0]), float(spacing_mm[1])),
            known if own and known else numbered,
        )

    def _frame(self, name: str, digest: str, number: int, read: Callable[[], Frame]) -> NamedFrame:
        return NamedFrame(name, f"{digest}-{number}", str(self.path), number, read)


def _given(image: np.ndarray, spacing_mm: tuple[float, float] | None) -> Callable[[], Frame]:
    return lambda: Frame(image, spacing_mm)


def sources_of(path: Path) -> list[Source]:
    """Find what there is to segment.

    Parameters
    ----------
    path : Path
        An image, a video, a tracked sweep, or a folder that holds images and videos at any depth.

    Returns
    -------
    list of Source
        Sources in natural order, with names that are all different: files that differ in their suffix alone keep it.

    Raises
    ------
    InputError
        If the path is none of them, or the folder holds none.
    """
    if _is_sweep(path):
        return [Source(path, path.name.split(".")[0], "sweep")]
    if path.is_file():
        kind = _kind(path)
        if kind is None:
            raise InputError(
                f"input: expected an image ({', '.join(IMAGE_SUFFIXES)}), a video ({', '.join(VIDEOS)}), a tracked "
                f"sweep or a folder, received {path}"
            )
        return [Source(path, _stem(path), kind)]
    found = [
        (file, kind)
        for file in sorted(path.rglob("*"), key=lambda file: natural_key(file.relative_to(path).as_posix()))
        if not any(part.startswith(".") for part in file.relative_to(path).parts)
        and file.is_file()
        and (kind := _kind(file)) is not None
    ]
    if not found:
        raise InputError(
            f"input: expected images ({', '.join(IMAGE_SUFFIXES)}) or videos ({', '.join(VIDEOS)}) in {path}, "
            "found none"
        )
    names = [file.relative_to(path).parent / _stem(file) for file, _ in found]
    count = Counter(name.as_posix().casefold() for name in names)
    return [
        Source(
            file,
            (name if count[name.as_posix().casefold()] == 1 else name.parent / file.name).as_posix(),
            kind,
        )
        for (file, kind), name in zip(found, names, strict=True)
    ]


def read_video(path: Path) -> Iterator[np.ndarray]:
    """Decode the frames of a video.

    Parameters
    ----------
    path : Path
        The video.

    Yields
    ------
    ndarray of uint8, shape (h, w, 3)
        Frames in RGB, in order.

    Raises
    ------
    InputError
        If the package av is not installed, or the file can't be decoded.
    """
    try:
        import av
    except ModuleNotFoundError as missing:
        raise InputError(
            f"{path}: expected the package av to read a video, found none ({INSTALL_VIDEO})"
        ) from missing
    with reading(path, "a video that can be decoded"), av.open(str(require_regular(path))) as container:
        for frame in container.decode(video=0):
            yield frame.to_ndarray(format="rgb24")


def _is_sweep(path: Path) -> bool:
    if path.is_file():
        return path.suffix.lower() in (*SEQUENCES, *BAGS)
    inside = (path, path / "sweep")
    named = any((folder / name).is_file() for folder in inside for name in ("sweep.yaml", METADATA))
    return (
        named
        or any((path / f"sweep.igs{suffix}").is_file() for suffix in SEQUENCES)
        or any(file.suffix.lower() in BAGS for file in path.glob("*"))
    )


def _kind(path: Path) -> str | None:
    if path.suffix.lower() in VIDEOS:
        return "video"
    if is_dicom(path):
        return "dicom"
    return "image" if path.suffix.lower() in IMAGE_SUFFIXES else None


def _stem(path: Path) -> str:
    """The name without a suffix that tells the format; DICOM files often have none."""
    return path.stem if path.suffix.lower() in (*IMAGE_SUFFIXES, *VIDEOS) else path.name
