"""Three sweeps for tests of the dashboard: the real sweep runner and tracker, trainings that are none."""

from __future__ import annotations

import inspect
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from scored_cases import scored_cases
from vessels import bent_tube

from experiments.analysis.segmentation.summary import pooled_metrics
from experiments.analysis.segmentation.tables import table
from experiments.cli import main
from experiments.outcome import InputData, Outcome
from registration.io.surfaces import write_surface

EPOCHS = 12
LEADS = {"UNet": 0.0, "AttentionUNet": 0.02}


def write_sweeps(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Track two networks with three folds each, two methods on two pieces of a vessel, and one registration."""
    from experiments.studies import segmentation

    no_training(segmentation, monkeypatch)
    words = ["study=segmentation", "model=unet,attention_unet", "trainer=smoke"]
    assert main(["-m", *words, f"out={folder / 'segmentation'}"]) == 0
    write_surface(folder / "tube.ply", bent_tube())
    words = [f"target={folder / 'tube.ply'}", "rigid=[single_icp,multistart]", "trials=2"]
    words += ["perturbation.moving_points=300", "perturbation.fixed_points=900"]
    assert main(["study=robustness", *words, f"out={folder / 'robustness'}"]) == 0
    words = [f"moving={folder / 'tube.ply'}", f"fixed={folder / 'tube.ply'}", "rigid=[single_icp]"]
    assert main(["study=register", *words, f"out={folder / 'register'}"]) == 0


def no_training(segmentation: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put known scores and drawn curves in place of the study's trainings; all else of it stays."""
    real = inspect.signature(segmentation.run)

    def run(**given: Any) -> Outcome:
        fold, name = given["fold"], type(given["model"]).__name__
        cases = scored_cases({name: LEADS.get(name, 0.0)})
        own = sorted(cases["group"].unique())[fold::3]
        cases = cases[cases["group"].isin(own)].assign(fold=fold, part="out_of_fold")
        history = tuple(
            {
                "train_loss": 1.0 / (1.0 + epoch) + 0.02 * fold,
                "validation_loss": 1.1 / (1.0 + epoch) + 0.03 * fold,
                "validation_dsc": 0.9 - 0.6 / (1.0 + epoch) - 0.01 * fold + LEADS.get(name, 0.0),
                "learning_rate": 0.001,
                "images_per_s": 100.0,
                "peak_memory_mb": 500.0,
            }
            for epoch in range(EPOCHS)
        )
        metrics = {**pooled_metrics(cases), "best_epoch": EPOCHS - 1.0, "training_s": 10.0}
        return Outcome(
            metrics=metrics,
            cases=cases,
            history=history,
            tables={"segmentation": table(cases)},
            findings=(f"Fold {fold} is drawn, not trained.",),
            inputs=(InputData("phantom", "0123456789abcdef", "simulator"),),
        )

    run.__signature__ = real  # type: ignore[attr-defined]
    monkeypatch.setattr(segmentation, "run", run)
