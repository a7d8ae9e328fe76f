"""The calls that rebuild the thesis, in order, read from ``conf/thesis.yaml``."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import yaml

from experiments.errors import InputError
from experiments.paths import conf_dir

SMOKE = "smoke"
# What the report writes in place of a folder that it does not know.
UNKNOWN_PLACES = {"trainer": "cpu", "data": "<folder of data sets>", "out": "<folder of results>"}


@dataclass(frozen=True)
class Step:
    """One call.

    Parameters
    ----------
    name : str
        Name of the step, which is that of its folder.
    words : str
        Words of the command line, with places for budget and folders.
    study : str, optional
        Study whose published values it measures; empty if it measures none.
    needs : str, optional
        Folder of a data set below that of all data sets; empty if it needs none.
    smoke : str, optional
        Further words where ``trainer=smoke`` only shows that all works.
    """

    name: str
    words: str
    study: str = ""
    needs: str = ""
    smoke: str = ""

    def arguments(self, trainer: str, data: str, out: str) -> list[str]:
        """Fill in budget and folders.

        Parameters
        ----------
        trainer : str
            Option of ``trainer=``.
        data : str
            Folder of the data sets.
        out : str
            Folder that the steps write to.

        Returns
        -------
        list of str
            Words of the command line after ``ctus``.
        """
        words = shlex.split(self.words) + (shlex.split(self.smoke) if trainer == SMOKE else [])
        # A word of the smoke budget takes the place of one for the same setting.
        last = {word.partition("=")[0]: word for word in words}
        places = {"trainer": trainer, "data": data, "out": out}
        return [_filled(word, places) for word in last.values()]

    @property
    def command(self) -> str:
        """The call as text, for a reader who has no run of it."""
        return f"ctus {' '.join(_filled(word, UNKNOWN_PLACES) for word in shlex.split(self.words))}"


def _filled(word: str, places: Mapping[str, str]) -> str:
    for name, value in places.items():
        word = word.replace(f"{{{name}}}", value)
    return word


@lru_cache(maxsize=1)
def thesis_steps() -> tuple[Step, ...]:
    """Read all steps.

    Returns
    -------
    tuple of Step
        The steps in the order in which they are run.

    Raises
    ------
    InputError
        If a step has other fields.
    """
    known = yaml.safe_load((conf_dir() / "thesis.yaml").read_text(encoding="utf-8"))["steps"]
    try:
        return tuple(Step(name, **fields) for name, fields in known.items())
    except TypeError as error:
        raise InputError(
            f"conf/thesis.yaml: expected steps of words, study, needs and smoke: {error}"
        ) from error


def command_for(study: str, datasets: tuple[str, ...] = ()) -> str:
    """Give the call that measures a published value.

    Parameters
    ----------
    study : str
        Name of the study.
    datasets : tuple of str, optional
        Data sets that the value was published of; a step on one of them comes first.

    Returns
    -------
    str
        The call; empty where no step measures it.
    """
    steps = [step for step in thesis_steps() if step.study == study]
    own = [step for step in steps if any(f"dataset={name}" in step.words for name in datasets)]
    return next((step.command for step in own or steps), "")
