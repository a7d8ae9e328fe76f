"""Which image belongs to which mask, by name; and what belongs to nothing, all of it at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from experiments.errors import InputError

REFUSE, SKIP = "refuse", "skip"


@dataclass(frozen=True)
class Pairing:
    """Image and mask of each case, and what is left over.

    Parameters
    ----------
    pairs : mapping of str to (Path, Path)
        Image and mask of each case.
    images : tuple of Path
        Images without a mask.
    masks : tuple of Path
        Masks without an image.
    others : tuple of Path
        Files among the images or masks that are no images. They do no harm and are only reported.
    """

    pairs: Mapping[str, tuple[Path, Path]]
    images: tuple[Path, ...] = ()
    masks: tuple[Path, ...] = ()
    others: tuple[Path, ...] = ()

    def __add__(self, other: Pairing) -> Pairing:
        return Pairing(
            {**self.pairs, **other.pairs},
            self.images + other.images,
            self.masks + other.masks,
            self.others + other.others,
        )

    @property
    def files(self) -> tuple[Path, ...]:
        """All files: images and masks of the pairs, then what is left over."""
        paired = tuple(path for both in self.pairs.values() for path in both)
        return (*paired, *self.images, *self.masks, *self.others)

    @property
    def unpaired(self) -> int:
        """How many images and masks are left over."""
        return len(self.images) + len(self.masks)

    def settled(self, unpaired: str, root: Path, remark: str = "") -> Pairing:
        """Return this pairing if it can be used.

        Parameters
        ----------
        unpaired : {'refuse', 'skip'}
            Whether images and masks that are left over are refused.
        root : Path
            The folder that file names are given relative to.
        remark : str
            What else is to be known, for the message.

        Returns
        -------
        Pairing
            This pairing.

        Raises
        ------
        InputError
            If something is left over that is refused, all of which the message names, or there is no pair.
        """
        if self.unpaired and unpaired == REFUSE:
            raise InputError(
                f"{root}: expected a mask of the same name for every image and an image for every mask, found "
                f"{' and '.join(self._parts(root))}{self._no_images(root)}{remark}; "
                f"pass dataset.unpaired={SKIP} to go on without them"
            )
        if not self.pairs:
            raise InputError(
                f"{root}: expected images and masks of the same names, found {' and '.join(self._parts(root))}"
            )
        return self

    def notes(self, root: Path) -> tuple[str, ...]:
        """Return what was left out, as sentences for reports.

        Parameters
        ----------
        root : Path
            The folder that file names are given relative to.

        Returns
        -------
        tuple of str
            Sentences.
        """
        notes = []
        if self.unpaired:
            notes.append(
                f"Left out as unpaired: {_counted(self.images, 'image')} without a mask and "
                f"{_counted(self.masks, 'mask')} without an image."
            )
        if self.others:
            notes.append(f"Not used: {self._no_images(root).removeprefix(', with ')}.")
        return tuple(notes)

    def _parts(self, root: Path) -> list[str]:
        parts = []
        for paths, one, other in ((self.images, "image", "mask"), (self.masks, "mask", "image")):
            if paths:
                parts.append(f"no {other} for {_counted(paths, one)} ({_listed(paths, root)})")
        return parts

    def _no_images(self, root: Path) -> str:
        if not self.others:
            return ""
        return f", with {_counted(self.others, 'file')} of another kind ({_listed(self.others, root)})"


def pair(
    images: Mapping[str, Path], masks: Mapping[str, Path], others: Iterable[Path] = (), prefix: str = ""
) -> Pairing:
    """Pair files of the same name.

    Parameters
    ----------
    images : mapping of str to Path
        Images by name; their order is kept.
    masks : mapping of str to Path
        Masks by name.
    others : iterable of Path
        Files that are no images.
    prefix : str
        What case names begin with, before the name of the file.

    Returns
    -------
    Pairing
        Pairs, and what is left over.
    """
    return Pairing(
        {f"{prefix}{name}": (path, masks[name]) for name, path in images.items() if name in masks},
        tuple(path for name, path in images.items() if name not in masks),
        tuple(path for name, path in masks.items() if name not in images),
        tuple(others),
    )


def require_choice(unpaired: object) -> None:
    """Check the setting ``unpaired``.

    Parameters
    ----------
    unpaired : object
        Its value.

    Raises
    ------
    InputError
        If it is neither refuse nor skip.
    """
    if unpaired not in (REFUSE, SKIP):
        raise InputError(f"unpaired: expected {REFUSE} or {SKIP}, received {unpaired!r}")


def _counted(paths: tuple[Path, ...], what: str) -> str:
    return f"{len(paths)} {what}{'' if len(paths) == 1 else 's'}"


def _listed(paths: tuple[Path, ...], root: Path) -> str:
    return ", ".join(str(path.relative_to(root) if path.is_relative_to(root) else path) for path in paths)
