"""Model files: every candidate that may become the consolidated model, and the one that did, with its certificate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from experiments.analysis.consolidation.candidates import AVERAGES, DISTILLED, ENSEMBLE
from experiments.analysis.consolidation.evaluation import Choice, Choices
from experiments.analysis.consolidation.summary import Decision
from experiments.outcome import JobResult
from models.model_file import ModelMember, SegmentationModel
from models.preprocessing.preprocessing import Preprocessing

FOLDER = "candidates"
Writer = Callable[[Path], None]


def write_candidates(
    choices: Choices,
    preprocessing: Preprocessing,
    folder: Path,
    data: Mapping[str, Any],
    notes: Mapping[str, Any],
) -> None:
    """Write every candidate that a certificate may choose, with its own calibration and thresholds.

    Parameters
    ----------
    choices : Choices
        What was chosen.
    preprocessing : Preprocessing
        Preprocessing of all networks.
    folder : Path
        Folder of the job; the files lie in ``candidates`` there.
    data : mapping
        Data sets by name.
    notes : mapping
        Further plain values.
    """
    (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    for choice in choices.others:
        if choice.candidate.name in (*AVERAGES, DISTILLED, ENSEMBLE):
            model = _model(choice, preprocessing, data, notes)
            model.save(folder / candidate_file(choice.candidate.name))


def candidate_file(name: str) -> str:
    """Return where the model of a candidate lies in the folder of its job.

    Parameters
    ----------
    name : str
        Name of the candidate.

    Returns
    -------
    str
        Path of the file from that folder on.
    """
    words = name.replace(" + ", "_").replace(" ", "_")
    return f"{FOLDER}/{words}.pt"


def write_model(folder: Path, decision: Decision, about: Mapping[str, Any]) -> None:
    """Write ``model.pt`` of a job: the candidate that was decided on, with its certificate.

    Parameters
    ----------
    folder : Path
        Folder of the job.
    decision : Decision
        The decision.
    about : mapping
        What the certificate says further.
    """
    _writer(folder / candidate_file(decision.certificate.consolidated), decision, about)(folder / "model.pt")


def model_writers(
    results: Sequence[JobResult],
    named: Mapping[int, tuple[str, str]],
    decided: Sequence[Decision],
    about: Mapping[str, Any],
) -> dict[str, Writer]:
    """Say how the models of a sweep are written: those of the first seed, one for each decision.

    Parameters
    ----------
    results : sequence of JobResult
        The jobs.
    named : mapping of int to tuple of str
        Network and data set of each job, as the decisions have them, by its place.
    decided : sequence of Decision
        The decisions.
    about : mapping
        What the certificates say further.

    Returns
    -------
    dict of str to callable
        What writes each file, by its name; none for jobs whose files are not at hand.
    """
    writers: dict[str, Writer] = {}
    for decision in decided:
        own = [
            result
            for place, result in enumerate(results)
            if named.get(place) == (decision.network, decision.dataset)
            and result.config.get("outer_fold") == decision.outer_fold
        ]
        if not own:
            continue
        first = min(own, key=lambda result: int(result.config["training_seed"]))
        source = first.workspace / candidate_file(decision.certificate.consolidated)
        if source.is_file():
            name = "model.pt" if len(decided) == 1 else f"model_{_words(decision.where)}.pt"
            writers[name] = _writer(source, decision, about)
    return writers


def _words(where: str) -> str:
    return "_".join("".join(each if each.isalnum() else " " for each in where).split())


def _writer(source: Path, decision: Decision, about: Mapping[str, Any]) -> Writer:
    def write(path: Path) -> None:
        model = SegmentationModel.load(source)
        replace(model, certificate=decision.certificate.block(**about)).save(path)

    return write


def _model(
    choice: Choice, preprocessing: Preprocessing, data: Mapping[str, Any], notes: Mapping[str, Any]
) -> SegmentationModel:
    step = choice.steps[-1]
    return SegmentationModel(
        tuple(ModelMember(each.name, each.recipe, each.weights) for each in choice.candidate.members),
        preprocessing,
        step.calibration,
        step.option,
        data=data,
        notes=notes,
    )
