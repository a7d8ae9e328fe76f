"""Jobs, refusals and runs of the study of propagation, on a sweep of a few small frames."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_sweeps import draw_sweeps
from propagation_rows import propagation_rows

from experiments.cli import compose_sweep
from experiments.datasets.san_raffaele import SanRaffaele
from experiments.datasets.simulated import SimulatedSubstitute
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome, Silent
from experiments.running import jobs as running_jobs
from experiments.running import run_names
from experiments.splits.group_splits import GroupSplits
from experiments.studies import propagation
from experiments.studies.propagation import networks
from models.errors import InputError as ModelInputError
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.initialisation import SharedRandom
from models.training.losses import DiceCrossEntropy
from models.training.settings import TrainerSettings
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Motion
from registration.phantom.settings import PhantomSettings
from registration.reconstruction.contours import ContourExtractor
from registration.reconstruction.mask_outliers import MaskOutliers
from registration.reconstruction.outlier_filters import VoxelDownsampling
from registration.reconstruction.surface import PoissonSurface
from registration.reconstruction.taubin import TaubinSmoothing
from registration.reconstruction.vessel_pieces import VesselPieces
from registration.rigid.multi_start import MultiStartICP

TINY = PhantomSettings(
    subset="artery", scanner=Scanner(height_px=64, width_px=64), motion=Motion(frames=30, length_mm=90.0)
)
NAMES = ["reference", "single_session", "full", "pruned"]


def config(**changes: Any) -> dict[str, Any]:
    split = {"_target_": "experiments.splits.group_splits.GroupSplits", "folds": 2}
    dataset = {"_target_": "experiments.datasets.san_raffaele.SanRaffaele", "root": "none", "simulate": True}
    settings = {
        "split": split,
        "dataset": dataset,
        "configurations": NAMES,
        "fold": None,
        "model_paths": None,
    }
    return {**settings, "phantoms": ["random"], "sweeps": 8, **changes}


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    cache = str(tmp_path_factory.mktemp("cache"))
    small = SimulatedSubstitute(subjects=8, recordings=1, frames=2, size_px=32, cache=cache)
    with pytest.MonkeyPatch.context() as patch:
        draw_sweeps(patch)
        patch.setenv("CTUS_HOME", str(tmp_path_factory.mktemp("project")))
        yield {
            "dataset": SanRaffaele("none", simulate=True, substitute=small, blocks=4, gap_frames=1),
            "configurations": ["full"], "model_paths": None, "split": GroupSplits(2), "model": UNet(width=4, depth=2),
            "preprocessing": Preprocessing(32), "loss": DiceCrossEntropy(), "init": SharedRandom(), "fold": 0,
            "trainer": TrainerSettings(max_epochs=1, batch_size=4, learning_rate=0.01, patience=1, smoke=True),
            "augmentation": Augmentation(transforms=()), "phantom": TINY, "phantoms": ["artery"], "sessions": None,
            "first_sweep": 1000, "sweeps": 1, "mask_outliers": MaskOutliers(), "contours": ContourExtractor(),
            "filters": {"voxel": VoxelDownsampling(0.6)}, "surface": PoissonSurface(0.9, 4.0), "pieces": VesselPieces(),
            "smoothing": TaubinSmoothing(), "rigid": {"multistart": MultiStartICP()}, "deformable": {"none": None},
            "max_gap_s": 0.5, "samples": 500, "fixed_points": 1000, "inlier_mm": 1.0, "keep": 0.9, "workers": 1,
            "cache": cache, "seed": 0, "progress": Silent(),
        }  # fmt: skip


@pytest.fixture(scope="module")
def trained(settings: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> tuple[Outcome, Path]:
    workspace = tmp_path_factory.mktemp("job")
    return propagation.run(**settings, workspace=workspace), workspace


def test_one_job_for_the_reference_and_one_for_each_configuration_and_fold() -> None:
    found = propagation.jobs(config())
    assert found == [{"configurations": ["reference"]}] + [
        {"configurations": [name], "fold": fold} for name in NAMES[1:] for fold in (0, 1)
    ]
    # What a run has is enough to make it again.
    assert all(propagation.jobs(config(**job)) == [job] for job in found)


def test_model_files_take_the_place_of_the_trainings() -> None:
    names = ["reference", "mine", "other"]
    found = propagation.jobs(config(configurations=names, model_paths=["a.pt", "b.pt"]))
    assert found == [
        {"configurations": ["reference"]},
        {"configurations": ["mine"], "model_paths": ["a.pt"]},
        {"configurations": ["other"], "model_paths": ["b.pt"]},
    ]
    for job in found:
        assert propagation.jobs(config(**{"model_paths": ["a.pt", "b.pt"], **job})) == [job]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"configurations": []}, "configurations: expected a list of configurations"),
        ({"configurations": "full"}, "configurations: expected a list of configurations"),
        ({"configurations": ["full", "full"]}, "configurations: expected each once"),
        ({"configurations": ["half"]}, "configurations: expected each one of single_session, full"),
        (
            {"model_paths": ["a.pt"]},
            "model_paths: expected a list with one file for each of configurations but",
        ),
        ({"model_paths": "a.pt"}, "model_paths: expected a list with one file"),
        ({"fold": 2}, "fold: expected 0 to 1, or null for all, received 2"),
        (
            {"split": {"_target_": "experiments.splits.group_splits.GroupSplits", "outer_folds": 2}},
            "split: expected folds of every configuration alike",
        ),
        (
            {"dataset": {"_target_": "experiments.datasets.usgra.Usgra", "root": "none"}},
            "dataset: expected san_raffaele, which has configurations",
        ),
    ],
)
def test_refuses_what_is_no_job(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        propagation.jobs(config(**changes))


def test_what_is_missing_is_refused_before_any_job(settings: dict[str, Any], tmp_path: Path) -> None:
    names = (
        "dataset",
        "configurations",
        "model_paths",
        "model",
        "preprocessing",
        "init",
        "phantom",
        "phantoms",
    )
    names += ("sessions", "first_sweep", "sweeps", "samples", "cache", "rigid", "deformable")
    parts = {name: settings[name] for name in names}
    propagation.check(**parts)
    with pytest.raises(InputError, match="model_paths: expected model files"):
        propagation.check(**{**parts, "model_paths": [str(tmp_path / "none.pt")]})
    with pytest.raises(InputError, match="first_sweep: expected 1000 or more"):
        propagation.check(**{**parts, "first_sweep": 3})
    with pytest.raises(InputError, match="samples: expected"):
        propagation.check(**{**parts, "samples": 0})
    with pytest.raises(ModelInputError, match="image size"):
        propagation.check(**{**parts, "model": UNet(4, 3), "preprocessing": Preprocessing(30)})
    with pytest.raises(InputError, match="expected the folder of data set san_raffaele_full"):
        propagation.check(**{**parts, "dataset": SanRaffaele("none")})
    # Neither the reference nor a model file needs the data set.
    propagation.check(**{**parts, "dataset": SanRaffaele("none"), "configurations": ["reference"]})


def test_a_trained_network_segments_the_sweeps_and_every_row_says_simulated(
    trained: tuple[Outcome, Path],
) -> None:
    outcome, workspace = trained
    assert outcome.cases is not None
    (row,) = outcome.cases.to_dict("records")
    assert (row["configuration"], row["model"], row["fold"]) == ("full", "smoke-trained unet", 0)
    assert (row["vessel"], row["sweep"], row["frames"]) == ("artery", 1000, 30)
    assert row["simulated"]
    assert outcome.tags["simulated"] == "true"
    assert outcome.tags["configuration"] == "full"
    assert outcome.metrics["train_cases"] > 0
    assert 0 <= outcome.metrics["dsc_mean"] < 1
    assert (workspace / "model.pt").is_file()
    assert outcome.inputs[0].source == "simulator"
    assert any(finding.startswith("Simulated: no image of San Raffaele") for finding in outcome.findings)


def test_a_model_file_gives_the_rows_that_its_training_gave(
    trained: tuple[Outcome, Path], settings: dict[str, Any], tmp_path: Path
) -> None:
    first, workspace = trained
    files = {"configurations": ["mine"], "model_paths": [str(workspace / "model.pt")], "fold": None}
    again = propagation.run(**{**settings, **files}, workspace=tmp_path)
    assert first.cases is not None
    assert again.cases is not None
    measured = ["dsc", "hd95_mm", "missed", "surface_rmse_mm", "tre_mm"]
    assert again.cases[measured].equals(first.cases[measured])
    (row,) = again.cases.to_dict("records")
    assert (row["configuration"], row["model"], row["fold"]) == ("mine", "unet", networks.NO_FOLD)
    assert "train_cases" not in again.metrics
    assert again.inputs == ()


def test_the_reference_is_a_lower_bound_and_a_network_that_finds_nothing_has_no_result(
    settings: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcome = propagation.run(
        **{**settings, "configurations": ["reference"], "fold": None}, workspace=tmp_path
    )
    assert outcome.metrics["dsc_mean"] == 1.0
    assert outcome.metrics["surface_rmse_mm_median"] < 0.6
    assert outcome.metrics["registrations_failed"] == 0
    blind = networks.MaskSource(lambda sweep: np.zeros(sweep.masks.shape), "unet", pictures=False)
    monkeypatch.setattr(networks, "of_file", lambda *_: blind)
    files = {"configurations": ["mine"], "model_paths": ["mine.pt"]}
    lost = propagation.run(**{**settings, **files}, workspace=tmp_path)
    assert lost.metrics["missed_rate"] == 1.0
    assert lost.metrics["registrations_failed"] == lost.metrics["surfaces_failed"] == 1
    assert np.isinf(lost.metrics["tre_mm_median"])
    both = [JobResult({"configurations": []}, {}, one.cases, tmp_path) for one in (outcome, lost)]
    summary = propagation.summarise(both)
    assert "1 of 2 surfaces and 1 of 2 registrations failed" in summary.findings[-3]
    assert propagation.summarise([]).findings == ("No job has sweeps to compare.",)


def test_folds_of_a_configuration_have_their_metrics_together() -> None:
    results = [
        JobResult({"configurations": ["full"], "fold": fold}, {}, rows, Path("nowhere"))
        for fold, rows in propagation_rows({"full": 0.8}, folds=2).groupby("fold")
    ]
    found = propagation.over_repeats(results)
    assert found["dsc_n"] == 16
    assert set(propagation.HEADLINE) <= set(found)
    assert propagation.over_repeats([]) == {}


def test_runs_are_named_by_what_made_the_masks() -> None:
    ((point, _),) = compose_sweep(
        [
            "study=propagation",
            "dataset.simulate=true",
            "configurations=[reference,mine]",
            "model_paths=[runs/a.pt]",
        ]
    )
    changed = [{**point, **change} for change in propagation.jobs(point)]
    parts = [
        running_jobs.Job(each, str(number), f"configurations={each['configurations'][0]}")
        for number, each in enumerate(changed)
    ]
    assert [run_names.job_name(job, with_subject=True) for job in parts] == [
        "random, multistart + cpd, configuration reference",
        "random, a.pt + multistart + cpd, configuration mine",
    ]
    own = run_names.parameters(parts[1])
    assert (own["model"], own["configuration"]) == ("a.pt", "mine")
    assert not {"dataset", "loss", "budget", "fold"} & set(own)
