"""Choices on selection groups first, scores on test groups after: one job's candidates from trained folds to rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.analysis.consolidation.calibrations import FittedCalibrations, fit_calibrations
from experiments.analysis.consolidation.candidates import ENSEMBLE, MEAN_FOLD, NETWORKS, Candidate
from experiments.analysis.consolidation.predictions import (
    IDENTITY,
    Prediction,
    PreparedCases,
    ensemble,
    predict,
    prepare,
)
from experiments.analysis.consolidation.rows import (
    SELECTION,
    TEST,
    as_best_fold,
    best_fold_rows,
    candidate_row,
    case_rows,
    reliability_rows,
)
from experiments.analysis.consolidation.thresholds import HALF, RAW, Step, choose_steps
from experiments.outcome import Progress
from models.averaging import Member
from models.labelled_frames import LabelledFrames
from models.postprocessing import PostprocessingGrid
from models.preprocessing.preprocessing import Preprocessing

AS_IT_IS = (Step(RAW, IDENTITY, HALF),)


@dataclass(frozen=True)
class ChoiceSettings:
    """What is chosen on selection groups, and among what.

    Parameters
    ----------
    calibration : str
        Calibration that thresholds are chosen behind: one of ``CALIBRATIONS``.
    grid : PostprocessingGrid
        Thresholds and smallest areas to choose from.
    max_false_alarm_rate : float or None
        As in ``select_postprocessing``.
    band_px : float
        Half width of the band around the boundary in px of the network's size.
    """

    calibration: str
    grid: PostprocessingGrid
    max_false_alarm_rate: float | None
    band_px: float


@dataclass(frozen=True, eq=False)
class Choice:
    """All that was chosen for a candidate without any test group.

    Parameters
    ----------
    candidate : Candidate
        The candidate.
    calibrations : FittedCalibrations
        Its calibrations, by its own logits.
    steps : tuple of Step
        From logits to masks; the last is the choice. A fold has the first alone.
    """

    candidate: Candidate
    calibrations: FittedCalibrations
    steps: tuple[Step, ...]


@dataclass(frozen=True, eq=False)
class Choices:
    """All choices of a job.

    Parameters
    ----------
    folds : tuple of Choice
        The folds' networks.
    others : tuple of Choice
        Candidates of all folds.
    best_fold : int
        Number of the best fold.
    rows : list of dict
        Scores of all candidates on selection groups.
    """

    folds: tuple[Choice, ...]
    others: tuple[Choice, ...]
    best_fold: int
    rows: list[dict[str, Any]]

    def of(self, name: str) -> Choice:
        """Return what was chosen for a candidate of all folds.

        Parameters
        ----------
        name : str
            Name of the candidate.

        Returns
        -------
        Choice
            The choice.
        """
        return next(choice for choice in self.others if choice.candidate.name == name)


@dataclass(frozen=True, eq=False)
class Predictions:
    """Logits of candidates on one set of cases; each network is run once.

    Parameters
    ----------
    cases : PreparedCases
        The cases.
    folder : Path
        Folder for the logits.
    batch_size : int
        Number of cases in a batch.
    device : str
        ``cpu`` or ``cuda``.
    known : dict, optional
        What was predicted, by the identity of the member.
    """

    cases: PreparedCases
    folder: Path
    batch_size: int
    device: str
    known: dict[int, Prediction] = field(default_factory=dict, repr=False)

    def __call__(self, candidate: Candidate) -> Prediction:
        """Predict the cases.

        Parameters
        ----------
        candidate : Candidate
            Network, or several.

        Returns
        -------
        Prediction
            Its logits.
        """
        found = [self._of(member) for member in candidate.members]
        if len(found) == 1:
            return found[0]
        return ensemble(found, self.folder / f"mean_{candidate.name}.npy")

    def _of(self, member: Member) -> Prediction:
        if id(member) not in self.known:
            network = member.recipe()
            network.load_state_dict(dict(member.weights))
            path = self.folder / f"network_{len(self.known)}.npy"
            self.known[id(member)] = predict(
                network, self.cases, path, batch_size=self.batch_size, device=self.device
            )
        return self.known[id(member)]


def choose(
    folds: Sequence[Candidate],
    others: Sequence[Candidate],
    selection: Predictions,
    out_of_fold: Sequence[Predictions],
    settings: ChoiceSettings,
    progress: Progress,
) -> Choices:
    """Make every choice, on selection groups and, for the folds' own calibration, out-of-fold cases.

    Parameters
    ----------
    folds : sequence of Candidate
        The folds' networks.
    others : sequence of Candidate
        Candidates of all folds.
    selection : Predictions
        Predictions of the selection cases.
    out_of_fold : sequence of Predictions
        For each fold those of the cases that it left out.
    settings : ChoiceSettings
        What is chosen.
    progress : Progress
        Shows the candidates.

    Returns
    -------
    Choices
        The choices.
    """
    rows: list[dict[str, Any]] = []
    fold_choices, choices = [], []
    for number, (candidate, unseen) in enumerate(zip(folds, out_of_fold, strict=True)):
        rows += case_rows(selection(candidate), AS_IT_IS, part=SELECTION, model=MEAN_FOLD, fold=number)
        fold_choices.append(
            Choice(candidate, fit_calibrations(unseen(candidate), band_px=settings.band_px), AS_IT_IS)
        )
    for candidate in progress.track(others, "choices on selection groups", len(others)):
        prediction = selection(candidate)
        rows += case_rows(prediction, AS_IT_IS, part=SELECTION, model=candidate.name)
        fitted = fit_calibrations(prediction, band_px=settings.band_px)
        steps = choose_steps(
            prediction,
            fitted.scalings[settings.calibration],
            settings.grid,
            max_false_alarm_rate=settings.max_false_alarm_rate,
        )
        choices.append(Choice(candidate, fitted, steps))
    best, copies = best_fold_rows(rows)
    return Choices(tuple(fold_choices), tuple(choices), best, rows + copies)


def score(
    choices: Choices, test: Predictions, settings: ChoiceSettings, progress: Progress
) -> list[dict[str, Any]]:
    """Score every candidate once on test groups, with all choices made.

    Parameters
    ----------
    choices : Choices
        The choices.
    test : Predictions
        Predictions of the test cases.
    settings : ChoiceSettings
        Width of the boundary band.
    progress : Progress
        Shows the candidates.

    Returns
    -------
    list of dict
        Rows of cases, reliability and costs.
    """
    rows: list[dict[str, Any]] = []
    prepared_s, band_px = test.cases.seconds_per_frame, settings.band_px
    for number, choice in enumerate(choices.folds):
        found = test(choice.candidate)
        rows += case_rows(found, choice.steps, part=TEST, model=MEAN_FOLD, fold=number)
        rows += reliability_rows(found, choice.calibrations, band_px=band_px, model=MEAN_FOLD, fold=number)
        rows.append(
            candidate_row(choice.candidate, MEAN_FOLD, prepared_s + found.seconds_per_frame)
            | {"fold": number}
        )
    rows += as_best_fold(rows, choices.best_fold)
    for choice in progress.track(choices.others, "scores on test groups", len(choices.others)):
        name, found = choice.candidate.name, test(choice.candidate)
        rows += case_rows(found, choice.steps, part=TEST, model=name)
        rows += reliability_rows(found, choice.calibrations, band_px=band_px, model=name)
        rows.append(
            candidate_row(choice.candidate, name, prepared_s + found.seconds_per_frame, **_described(choice))
        )
    return rows


def _described(choice: Choice) -> Mapping[str, Any]:
    """The chosen thresholds in columns."""
    step = choice.steps[-1]
    hysteresis, morphology = step.option.hysteresis, step.option.morphology
    return {
        "temperature": step.calibration.temperature,
        "bias": step.calibration.bias,
        "low": hysteresis.low,
        "high": hysteresis.high,
        "relative": float(hysteresis.relative),
        "min_peak": hysteresis.min_peak,
        "min_area": step.option.min_area,
        "largest_only": float(morphology.largest_only),
        "closing_radius_px": morphology.closing_radius_px or 0.0,
        "fill_holes": float(morphology.fill_holes),
    }


def ensembles(members: Sequence[Member], second: Sequence[Member]) -> list[Candidate]:
    """Set up the ensemble of the folds, and that of the folds of two networks.

    Parameters
    ----------
    members : sequence of Member
        Networks of the folds.
    second : sequence of Member
        Those of a second architecture; may be empty.

    Returns
    -------
    list of Candidate
        The ensembles.
    """
    found = [Candidate(ENSEMBLE, tuple(members))]
    return [*found, Candidate(NETWORKS, (*members, *second))] if second else found


def predictions_of(
    frames: LabelledFrames,
    preprocessing: Preprocessing,
    folder: Path,
    *,
    batch_size: int,
    device: str,
) -> Predictions:
    """Prepare cases for prediction.

    Parameters
    ----------
    frames : LabelledFrames
        The cases.
    preprocessing : Preprocessing
        What they go through.
    folder : Path
        Folder for images and logits.
    batch_size : int
        Number of cases in a batch.
    device : str
        ``cpu`` or ``cuda``.

    Returns
    -------
    Predictions
        The prepared cases, none predicted yet.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return Predictions(prepare(frames, preprocessing, folder / "cases"), folder, batch_size, device)
