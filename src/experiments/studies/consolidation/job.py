"""One job: folds trained, candidates made, everything chosen on selection groups, then test groups scored."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.analysis.consolidation.candidates import (
    DISTILLED,
    AveragingInputs,
    Candidate,
    averages,
    barriers,
)
from experiments.analysis.consolidation.evaluation import (
    Choices,
    ChoiceSettings,
    Predictions,
    choose,
    ensembles,
    predictions_of,
    score,
)
from experiments.analysis.consolidation.rows import barrier_rows
from experiments.analysis.consolidation.summary import Decision
from experiments.analysis.segmentation.fold_run import FoldRun, device_of
from experiments.datasets.protocol import DataSet
from experiments.outcome import Progress
from experiments.splits.split_set import SplitSet
from experiments.studies.consolidation.model_files import write_candidates, write_model
from experiments.studies.consolidation.training import (
    TrainedFolds,
    cross_validation,
    distil,
    history_of,
    train_folds,
)
from models.averaging import Member
from models.labelled_frames import LabelledFrames
from models.processor import fixed_threads

if TYPE_CHECKING:
    from models.networks.registry import NetworkRecipe
    from models.training.distillation import Distillation
    from models.training.fold import TrainedFold


@dataclass(frozen=True)
class JobSettings:
    """Settings of a job beside those of its trainings; as in ``study.run``.

    Parameters
    ----------
    second : NetworkRecipe or None
        Second network.
    choice : ChoiceSettings
        What is chosen on selection groups.
    distillation : Distillation or None
        Loss of the distilled network; None for no such network.
    aligned : bool
        Whether an average of aligned networks is made.
    barrier_points : int
        Number of points on a line.
    barrier_cases : int or None
        Largest number of cases that barriers are evaluated on.
    statistics_cases : int or None
        Largest number of training cases that statistics of channels are estimated on.
    """

    second: NetworkRecipe | None
    choice: ChoiceSettings
    distillation: Distillation | None
    aligned: bool
    barrier_points: int
    barrier_cases: int | None
    statistics_cases: int | None


@dataclass(frozen=True, eq=False)
class Consolidated:
    """What a job found.

    Parameters
    ----------
    run : FoldRun
        Settings of the trainings.
    choices : Choices
        All choices.
    rows : list of dict
        Rows of cases, reliability, barriers and costs.
    notes : tuple of str
        What averages are not there and why.
    history : tuple of dict
        Measures of each epoch, averaged over folds.
    training_s, evaluation_s : float
        Time of the trainings (earlier ones included) and of all the rest.
    """

    run: FoldRun
    choices: Choices
    rows: list[dict[str, Any]]
    notes: tuple[str, ...]
    history: tuple[dict[str, float], ...]
    training_s: float
    evaluation_s: float

    def write(self, folder: Path, decision: Decision, data: Mapping[str, Any]) -> None:
        """Write the models of all candidates and the one that was decided on.

        Parameters
        ----------
        folder : Path
            Folder of the job.
        decision : Decision
            The decision.
        data : mapping
            Name, digest and licence of the data set.
        """
        notes = {"network": self.run.model_name, "seed": self.run.seed}
        known = {str(data["name"]): {key: value for key, value in data.items() if key != "name"}}
        write_candidates(self.choices, self.run.preprocessing, folder, known, notes)
        write_model(folder, decision, {"data": [data]})


@dataclass(frozen=True, eq=False)
class ConsolidationJob:
    """One seed of one outer fold.

    Parameters
    ----------
    run : FoldRun
        Settings of the trainings.
    dataset : DataSet
        Data set, for its name and licence.
    frames : LabelledFrames
        All cases.
    splits : SplitSet
        Folds, selection and test of this job.
    settings : JobSettings
        Settings of what follows.
    scratch : Path
        Folder for files that are not kept.
    progress : Progress
        Receives notes and progress.
    """

    run: FoldRun
    dataset: DataSet
    frames: LabelledFrames
    splits: SplitSet
    settings: JobSettings
    scratch: Path
    progress: Progress

    def __call__(self) -> Consolidated:
        """Do the job.

        Returns
        -------
        Consolidated
            What it found.
        """
        trained = self._train(self.run.model)
        second = None if self.settings.second is None else self._train(self.settings.second)
        with fixed_threads(self.run.trainer.threads):
            return self._evaluated(trained, second)

    def _evaluated(self, trained: TrainedFolds, second: TrainedFolds | None) -> Consolidated:
        """Everything after the folds' trainings."""
        distilled = None if self.settings.distillation is None else self._distil(trained)
        begin_s = time.perf_counter()
        selection = self._predictions("selection")
        unseen = [self._predictions(f"fold_{split.fold}", split.fold) for split in self.splits]
        folds = [Candidate(member.name, (member,)) for member in trained.members]
        others, notes, lines = self._candidates(trained, second, selection, unseen)
        if distilled is not None:
            others.append(Candidate(DISTILLED, (distilled[0],)))
        choices = choose(folds, others, selection, unseen, self.settings.choice, self.progress)
        # Nothing is chosen below this line: only now are the test groups looked at.
        rows = score(choices, self._predictions("held_out"), self.settings.choice, self.progress)
        trainings = [
            *trained.trained,
            *(second.trained if second else ()),
            *(distilled[1:] if distilled else ()),
        ]
        return Consolidated(
            self.run,
            choices,
            [*choices.rows, *rows, *lines],
            notes,
            history_of(trained.trained),
            sum(one.runtime_s for one in trainings),
            time.perf_counter() - begin_s,
        )

    def _train(self, model: NetworkRecipe) -> TrainedFolds:
        return train_folds(
            self.run, model, self.dataset, self.frames, self.splits, self.scratch, self.progress
        )

    def _distil(self, trained: TrainedFolds) -> tuple[Member, TrainedFold]:
        """The network that is trained on the ensemble's probabilities."""
        assert self.settings.distillation is not None
        (together,) = ensembles(trained.members, ())
        teacher = self._prepared(cross_validation(self.frames, self.splits), "teacher")(together)
        targets = np.stack([teacher.probability(index) for index in range(len(teacher.cases))]).astype(
            np.float16
        )
        return distil(
            self.run,
            self.dataset,
            self.frames,
            self.splits,
            targets,
            self.settings.distillation,
            self.scratch,
            self.progress,
        )

    def _predictions(self, side: str, fold: int | None = None) -> Predictions:
        splits = self.splits.splits
        split = splits[0] if fold is None else next(one for one in splits if one.fold == fold)
        return self._prepared(split.of(self.frames, side if fold is None else "test"), side)

    def _prepared(self, frames: LabelledFrames, name: str) -> Predictions:
        return predictions_of(
            frames,
            self.run.preprocessing,
            self.scratch / name,
            batch_size=self.run.trainer.batch_size,
            device=device_of(self.run.trainer.accelerator),
        )

    def _candidates(
        self,
        trained: TrainedFolds,
        second: TrainedFolds | None,
        selection: Predictions,
        unseen: list[Predictions],
    ) -> tuple[list[Candidate], tuple[str, ...], list[dict[str, Any]]]:
        """The candidates of all folds, what is said of them, and the lines between the folds' networks."""
        inputs = AveragingInputs(
            selection.cases,
            tuple(each.cases for each in unseen),
            self.run.loss,
            self.run.trainer.batch_size,
            selection.device,
            self.settings.statistics_cases,
        )
        self.progress.note("averages of the folds' networks, and the lines between them")
        averaged, notes = averages(trained.members, inputs, aligned=self.settings.aligned)
        found = barriers(
            trained.members,
            inputs,
            n_points=self.settings.barrier_points,
            max_cases=self.settings.barrier_cases,
        )
        together = ensembles(trained.members, () if second is None else second.members)
        return [*averaged, *together], notes, barrier_rows(found)
