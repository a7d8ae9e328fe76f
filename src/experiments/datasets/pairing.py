"""Which image belongs to which mask, by name; and what belongs to nothing, all of it at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from experiments.errors import InputError

REFUSE, SKIP = "refuse", "skip"


@dataclass(frozen=True)
class Pairing:
    """Image and mask of each case, and what is left over: images, masks, and files that are neither.

    ``others`` are files among the images or masks that are no images. They do no harm and are only reported.
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
        """This pairing, if nothing is left over or ``unpaired`` is skip.

        Raises InputError that names all that is left over (relative to ``root``), with what is to be known ``remark``;
        and for skip where no image has a mask.
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
        """Sentences on what was left out, for whoever reads the results."""
        said = []
        if self.unpaired:
            said.append(
                f"Left out as unpaired: {_counted(self.images, 'image')} without a mask and "
                f"{_counted(self.masks, 'mask')} without an image."
            )
        if self.others:
            said.append(f"Not used: {self._no_images(root).removeprefix(', with ')}.")
        return tuple(said)

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
    """Pair files of the same name, in the order of ``images``; cases are called ``prefix`` and that name."""
    return Pairing(
        {f"{prefix}{name}": (path, masks[name]) for name, path in images.items() if name in masks},
        tuple(path for name, path in images.items() if name not in masks),
        tuple(path for name, path in masks.items() if name not in images),
        tuple(others),
    )


def require_choice(unpaired: object) -> None:
    """Raise InputError for a value of the setting ``unpaired`` that is not one."""
    if unpaired not in (REFUSE, SKIP):
        raise InputError(f"unpaired: expected {REFUSE} or {SKIP}, received {unpaired!r}")


def _counted(paths: tuple[Path, ...], what: str) -> str:
    return f"{len(paths)} {what}{'' if len(paths) == 1 else 's'}"


def _listed(paths: tuple[Path, ...], root: Path) -> str:
    return ", ".join(str(path.relative_to(root) if path.is_relative_to(root) else path) for path in paths)
