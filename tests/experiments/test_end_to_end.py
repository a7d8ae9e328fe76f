"""The whole path by the command line, small: train, segment an unseen sweep, register, export, restore."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
from PIL import Image

from experiments.cli import main
from experiments.tracking import Store

SMALL_PHANTOM = ["phantom.scanner.height_px=96", "phantom.scanner.width_px=96", "phantom.motion.frames=18"]


def search(home: Path, experiment: str) -> pd.DataFrame:
    """The runs of an experiment, read back by MLflow's own search."""
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{home / 'mlruns' / 'ctus.db'}")
    found = mlflow.search_runs(experiment_names=[experiment])
    assert isinstance(found, pd.DataFrame)
    return found


def test_the_whole_path(home: Path, capsys) -> None:
    networks, result = home / "networks", home / "pipeline"
    assert 0 == main(
        ["study=segmentation", "dataset=phantom", "dataset.subset=artery", "dataset.sweeps=3", "width=4",
         "split.folds=3", "dataset.frames_per_sweep=10", "dataset.size_px=96", "image_size_px=64",
         "trainer.max_epochs=8", "trainer.batch_size=4", "fold=0", "trainer.learning_rate=5e-3", f"out={networks}"]
    )  # fmt: skip
    runs = search(home, "segmentation")
    (run,) = runs.to_dict("records")
    assert run["status"] == "FINISHED"
    # Trained for seconds, it is rough; how well a network learns is tested where the networks are.
    assert run["metrics.dsc_mean"] > 0.1
    assert run["params.fold"] == "0"
    assert run["tags.simulated"] == "true"
    assert (networks / "model.pt").is_file()

    assert 0 == main(
        ["study=pipeline", f"model_path={networks / 'model.pt'}", *SMALL_PHANTOM, f"out={result}"]
    )  # fmt: skip
    (run,) = search(home, "pipeline").to_dict("records")
    assert run["metrics.points"] > 50
    assert run["metrics.tre_mm"] > 0
    assert run["metrics.rmse_mm"] > 0
    cases = Store().cases(run["run_id"])
    assert cases is not None
    assert len(cases) == 18

    assert 0 == main(
        ["study=robustness", f"target={result / 'model.ply'}", f"moving={result / 'cloud.ply'}", "trials=2",
         f"moving_truth={result / 'truth.json'}", "overlaps=[1.0]", "perturbation.moving_points=500"]
    )  # fmt: skip
    runs = search(home, "robustness")
    assert len(runs) == 3
    assert set(runs["params.trials"]) == {"2"}
    assert (runs["tags.ctus.kind"] == "job").sum() == 2

    assert 0 == main(
        [
            "study=register",
            f"moving={result / 'cloud.ply'}",
            f"fixed={result / 'model.ply'}",
            f"out={home / 'own'}",
        ]
    )
    answer = json.loads((home / "own" / "registration.json").read_text())
    (run,) = search(home, "register").to_dict("records")
    assert run["metrics.rmse_mm"] == answer["rmse_mm"]

    assert main(["study=export_runs"]) == 0
    assert main(["study=import_runs"]) == 0
    assert "Imported 0 runs" in capsys.readouterr().out
    assert len(pd.read_parquet(home / "results" / "runs" / "robustness" / "runs.parquet")) == 3


def test_a_missing_network_is_said_before_anything_is_simulated(home: Path, capsys) -> None:
    assert main(["study=pipeline", "model_path=nowhere.pt"]) == 2
    assert (
        "model_path: expected a model file or a network trained by study=segmentation"
        in capsys.readouterr().err
    )


def test_a_missing_root_is_one_sentence(home: Path, capsys) -> None:
    assert main(["study=segmentation", "dataset=usgra", f"dataset.root={home / 'nowhere'}"]) == 2
    said = capsys.readouterr().err.strip()
    assert "dataset.root=" in said
    assert "CC BY" in said
    assert "Traceback" not in said


def test_an_empty_cloud_is_one_sentence(home: Path, capsys) -> None:
    (home / "empty.xyz").write_text("")
    (home / "cube.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n")
    assert (
        main(
            [
                "study=register",
                f"moving={home / 'empty.xyz'}",
                f"fixed={home / 'cube.xyz'}",
                f"out={home / 'o'}",
            ]
        )
        == 2
    )
    assert "empty.xyz" in capsys.readouterr().err
    assert not (home / "o").exists()


def test_a_simulated_sweep_is_looked_at_and_converted(home: Path, capsys) -> None:
    made = home / "made"
    assert main(["study=simulate", *SMALL_PHANTOM, "phantom.motion.frames=6", f"out={made}"]) == 0
    assert main(["study=inspect_sweep", f"sweep={made / 'sweep'}", f"out={home / 'page'}"]) == 0
    (run,) = search(home, "inspect_sweep").to_dict("records")
    assert run["metrics.frames"] == 6
    assert (home / "page" / "sweep.html").is_file()
    words = ["study=convert", f"input={made / 'sweep'}", "format=plus_mha", f"out={home / 'plus'}"]
    assert main(words) == 0
    assert (home / "plus" / "sweep.igs.mha").is_file()
    capsys.readouterr()
    assert main(["study=inspect_sweep", f"sweep={home / 'nowhere'}"]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_image_and_mask_of_different_size_are_named(home: Path, capsys) -> None:
    root = home / "data"
    for folder, size in (("images", (40, 30)), ("masks", (40, 31))):
        (root / folder).mkdir(parents=True)
        Image.new("L", size, 255).save(root / folder / "frame7.png")
    (root / "groups.csv").write_text("case,group\nframe7,a\n")
    assert main(["study=segmentation", "dataset=folder", f"dataset.root={root}", "fold=0"]) == 2
    said = capsys.readouterr().err
    assert "frame7" in said
    assert "Traceback" not in said
