import csv
import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from drawn_vessels import drawn_frames

from models.predictor import Predictor
from models.train import main

SOURCE = Path(__file__).resolve().parents[2] / "src"
CONFIG = {
    "frames": "frames.npz",
    "split": "split.json",
    "dataset": "drawn",
    "seed": 0,
    "model": {"name": "unet", "width": 4, "depth": 3},
    "trainer": {"max_epochs": 2, "batch_size": 4, "image_size_px": 32, "learning_rate": 0.01, "patience": 2},
    "augmentation": {"flip": 0.5},
    "loss": {"dice_weight": 2.0},
}
# Everything that is installed here but need not be on a machine that only trains.
# Names of packages, and of distributions where they differ.
ABSENT = (
    *("scipy", "pandas", "matplotlib", "jaxtyping", "monai", "mlflow", "hydra", "hydra-core"),
    *("skimage", "scikit-image", "sklearn", "scikit-learn", "PIL", "pillow"),
)
ALONE = f"""
import sys
class Without:
    def __init__(self, finder):
        self.finder = finder
    def __getattr__(self, name):
        return getattr(self.finder, name)
    def find_spec(self, name, path=None, target=None):
        return None if name.split(".")[0] in {ABSENT!r} else self.finder.find_spec(name, path, target)
    def find_distributions(self, context):
        found = getattr(self.finder, "find_distributions", lambda context: ())(context)
        return (one for one in found if one.metadata["Name"].lower() not in {ABSENT!r})
sys.meta_path = [Without(finder) for finder in sys.meta_path]
import runpy
sys.argv[0] = "models.train"
runpy.run_module("models.train", run_name="__main__")
"""


def write_inputs(folder: Path, **changes: object) -> Path:
    frames = drawn_frames(12, empty=1)
    frames.save(folder / "frames.npz")
    ids = frames.case_ids
    split = {"fold": 1, "train": ids[3:9], "validation": ids[9:], "test": ids[:3]}
    (folder / "split.json").write_text(json.dumps(split))
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump({**CONFIG, **changes}))
    return path


def test_trains_with_torch_and_lightning_alone(tmp_path) -> None:
    config = write_inputs(tmp_path)
    finished = subprocess.run(
        [sys.executable, "-c", ALONE, str(config), "--out", str(tmp_path / "out")],
        env={"PYTHONPATH": str(SOURCE), "PATH": "", "OMP_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    assert "epoch 2 of 2: validation DSC" in finished.stdout
    out = tmp_path / "out"
    written = {"model.pt", "cases.csv", "history.json", "metrics.json", "config.yaml"}
    assert {path.name for path in out.iterdir()} == written
    assert (out / "config.yaml").read_text() == config.read_text()
    with (out / "cases.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["case_id"] for row in rows] == ["case00", "case01", "case02"]
    assert rows[0]["false_alarm"] in ("0.0", "1.0") and rows[0]["dsc"] == "nan"
    assert all(float(row["hd95_mm"]) >= 0 for row in rows[1:])
    assert {(row["model"], row["dataset"], row["fold"]) for row in rows} == {("unet", "drawn", "1")}
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["dsc_n"] == 2 and metrics["epochs"] == 2
    assert metrics["dsc_mean"] == pytest.approx(sum(float(row["dsc"]) for row in rows[1:]) / 2)
    assert len(json.loads((out / "history.json").read_text())) == 2
    assert Predictor.load(out / "model.pt").preprocessing.image_size_px == 32


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": {"name": "vnet"}}, "network: expected one of"),
        ({"trainer": {"max_epochs": 2}}, "expected settings of a training, received others"),
        ({"seed": None}, "expected settings of a training"),
        ({"frames": "none.npz"}, "expected a file of labelled frames"),
        ({"loss": {"weight": 1}}, "expected settings of a training, received others"),
    ],
)
def test_refuses_with_one_sentence_and_code_2(
    tmp_path, capsys, changes: dict[str, object], message: str
) -> None:
    config = write_inputs(tmp_path, **changes)
    assert main([str(config), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert message in said and len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_names_a_setting_that_is_missing_and_a_case_that_is_not_there(tmp_path, capsys) -> None:
    config = write_inputs(tmp_path)
    config.write_text(yaml.safe_dump({key: value for key, value in CONFIG.items() if key != "trainer"}))
    assert main([str(config), "--out", str(tmp_path / "out")]) == 2
    assert "expected a value for trainer, received none" in capsys.readouterr().err
    config = write_inputs(tmp_path)
    (tmp_path / "split.json").write_text(
        json.dumps({"fold": 0, "train": ["x"], "validation": [], "test": []})
    )
    assert main([str(config), "--out", str(tmp_path / "out")]) == 2
    assert "split: expected cases of the frames file, received 'x'" in capsys.readouterr().err


def test_refuses_a_file_that_is_no_mapping(tmp_path, capsys) -> None:
    (tmp_path / "config.yaml").write_text("- 1\n")
    assert main([str(tmp_path / "config.yaml"), "--out", str(tmp_path)]) == 2
    assert "expected a YAML mapping, received list" in capsys.readouterr().err
    assert main([str(tmp_path / "none.yaml"), "--out", str(tmp_path)]) == 2
    assert "none.yaml: expected a YAML file" in capsys.readouterr().err
