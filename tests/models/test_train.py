import csv
import dataclasses
import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import torch
import yaml
from drawn_vessels import drawn_frames

from models.checkpoint import Checkpoint
from models.networks.efficientnet_unet import EfficientNetUNet
from models.networks.monai_network import MonaiNetwork
from models.networks.registry import recipes
from models.predictor import Predictor
from models.train import TrainingPlan, main

SOURCE = Path(__file__).resolve().parents[2] / "src"
CONFIG = {
    "frames": "frames.npz",
    "split": "split.json",
    "dataset": "drawn",
    "seed": 0,
    "model": {"name": "unet", "width": 4, "depth": 3},
    "preprocessing": {"image_size_px": 32},
    "trainer": {"max_epochs": 2, "batch_size": 4, "learning_rate": 0.01, "patience": 2},
    "augmentation": {"flip": 0.5},
    "loss": {"dice_weight": 2.0},
}
MACHINE = Path(__file__).resolve().parents[1] / "support" / "training_machine.py"
# Every network that needs no other package, with all that it can train.
SETTINGS = {
    "unet": {},
    "attention_unet": {},
    "unet3plus": {"deep_supervision": True, "classification_guided": True},
}
LONG = {"max_epochs": 5, "batch_size": 4, "learning_rate": 0.01, "patience": 5}
STEPS = 2  # of an epoch: 6 frames in batches of 4


def write_inputs(folder: Path, **changes: object) -> Path:
    frames = drawn_frames(12, empty=1)
    frames.save(folder / "frames.npz")
    ids = frames.case_ids
    split = {"fold": 1, "train": ids[3:9], "validation": ids[9:], "test": ids[:3]}
    (folder / "split.json").write_text(json.dumps(split))
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump({**CONFIG, **changes}))
    return path


@dataclasses.dataclass(frozen=True)
class Machine:
    """What happened on a machine with the necessary alone."""

    folder: Path
    finished: subprocess.CompletedProcess[str]


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    """Every network trained for two epochs, then a longer training killed in the middle of its third epoch."""
    folder = tmp_path_factory.mktemp("machine")
    calls = []
    for name, settings in SETTINGS.items():
        (folder / name).mkdir()
        config = write_inputs(folder / name, model={"name": name, "width": 4, "depth": 3, **settings})
        calls.append(f"{config},--out,{folder / name / 'out'}")
    (folder / "long").mkdir()
    config = write_inputs(folder / "long", trainer=LONG)
    calls.append(f"{config},--out,{folder / 'long' / 'out'}")
    steps_before = len(SETTINGS) * CONFIG["trainer"]["max_epochs"] * STEPS
    finished = subprocess.run(
        [sys.executable, str(MACHINE), str(steps_before + 3 * STEPS), *calls],
        # The same number of threads, for results that are the same to the last bit.
        env={"PYTHONPATH": str(SOURCE), "PATH": "", "OMP_NUM_THREADS": str(torch.get_num_threads())},
        capture_output=True,
        text=True,
        check=False,
    )
    return Machine(folder, finished)


def test_trains_every_network_with_torch_lightning_and_scikit_image_alone(machine: Machine) -> None:
    larger = {MonaiNetwork.name, EfficientNetUNet.name}  # not installed here; 64 px at least
    assert set(SETTINGS) == set(recipes()) - larger
    said = machine.finished.stdout
    assert said.count("trained ") == len(SETTINGS), machine.finished.stderr
    assert said.startswith("found: ['torch', 'lightning', 'skimage']\n")
    assert said.count("epoch 2 of 2: validation DSC") == len(SETTINGS)
    for name in SETTINGS:
        assert Predictor.load(machine.folder / name / "out" / "model.pt").preprocessing.image_size_px == 32
        with (machine.folder / name / "out" / "cases.csv").open(newline="") as file:
            assert {row["model"] for row in csv.DictReader(file)} == {name}


def test_writes_what_becomes_a_run(machine: Machine) -> None:
    folder = machine.folder / "unet"
    out = folder / "out"
    written = {"model.pt", "cases.csv", "history.json", "metrics.json", "config.yaml", "state"}
    assert {path.name for path in out.iterdir()} == written
    assert (out / "config.yaml").read_text() == (folder / "config.yaml").read_text()
    with (out / "cases.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["case_id"] for row in rows] == ["case00", "case01", "case02"]
    assert rows[0]["false_alarm"] in ("0.0", "1.0") and rows[0]["dsc"] == "nan"
    assert all(float(row["hd95_mm"]) >= 0 for row in rows[1:])
    assert {(row["model"], row["dataset"], row["fold"]) for row in rows} == {("unet", "drawn", "1")}
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["dsc_n"] == 2 and metrics["epochs"] == 2
    assert metrics["dsc_mean"] == pytest.approx(sum(float(row["dsc"]) for row in rows[1:]) / 2)
    history = json.loads((out / "history.json").read_text())
    assert len(history) == 2 and {"images_per_s", "peak_memory_mb", "learning_rate"} <= set(history[0])


def test_a_killed_training_is_resumed_to_the_same_result(machine: Machine, tmp_path, capsys) -> None:
    assert machine.finished.returncode == -signal.SIGKILL, machine.finished.stderr
    assert "epoch 2 of 5" in machine.finished.stdout and "epoch 3 of 5" not in machine.finished.stdout
    config, out = machine.folder / "long" / "config.yaml", machine.folder / "long" / "out"
    assert sorted(path.name for path in out.iterdir()) == ["state"]
    before = torch.load(out / "state" / "state.pt", weights_only=True)["history"]
    assert 1 <= len(before) <= 2
    assert main([str(config), "--out", str(out), "--resume"]) == 0
    assert "epoch 5 of 5" in capsys.readouterr().out
    assert main([str(config), "--out", str(tmp_path)]) == 0
    resumed, whole = (json.loads((folder / "history.json").read_text()) for folder in (out, tmp_path))
    assert resumed[: len(before)] == list(before)
    measures = ("train_loss", "validation_loss", "validation_dsc", "learning_rate")
    assert [[epoch[name] for name in measures] for epoch in resumed] == [
        [epoch[name] for name in measures] for epoch in whole
    ]
    weights = [Checkpoint.load(folder / "model.pt").weights for folder in (out, tmp_path)]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])
    assert (out / "cases.csv").read_text() == (tmp_path / "cases.csv").read_text()


def test_refuses_to_resume_another_training(tmp_path, capsys) -> None:
    config = write_inputs(tmp_path)
    assert main([str(config), "--out", str(tmp_path / "out")]) == 0
    write_inputs(tmp_path, seed=1)
    assert main([str(config), "--out", str(tmp_path / "out"), "--resume"]) == 2
    assert "state.pt: expected the state of this very training" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"model": {"name": "vnet"}}, "network: expected one of"),
        ({"trainer": {"max_epochs": 2}}, "expected settings of a training, received others"),
        ({"seed": None}, "expected settings of a training"),
        ({"frames": "none.npz"}, "expected a file of labelled frames"),
        ({"loss": {"weight": 1}}, "loss: expected settings of dice_cross_entropy, received others"),
        ({"loss": {"name": "hinge"}}, "loss: expected one of"),
        ({"augmentation": [{"name": "Turn"}]}, "augmentation[0]: expected a transform"),
        ({"seed": 1.5}, "seed: expected a whole number, received 1.5"),
        ({"loss": {"dice_weight": "much"}}, "dice_weight: expected a number, received 'much'"),
        ({"model": {"name": "unet", "width": 4.5}}, "width: expected a whole number, received 4.5"),
        (
            {"trainer": {"max_epochs": 2, "batch_size": 1.5, "learning_rate": 0.01, "patience": 2}},
            "trainer.batch_size: expected a whole number, received 1.5",
        ),
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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"test": []}, "split: expected at least one case in test, received none"),
        ({"validation": []}, "split: expected at least one case in validation, received none"),
        ({"test": [0, 3]}, "split: expected case 'case_03' once, received it in train and in test"),
        ({"train": [3, 4, 3]}, "split: expected case 'case_03' once, received it in train and in train"),
        (
            {"validation": [9, 4]},
            "split: expected case 'case_04' once, received it in train and in validation",
        ),
        ({"held_out": [9]}, "split: expected case 'case_09' once, received it in validation and in held_out"),
    ],
)
def test_refuses_a_split_that_leaks_or_tests_nothing(tmp_path, capsys, changes, message: str) -> None:
    config = write_inputs(tmp_path)
    names = drawn_frames(12, empty=1).case_ids
    split = json.loads((tmp_path / "split.json").read_text())
    split |= {side: [names[index] for index in cases] for side, cases in changes.items()}
    (tmp_path / "split.json").write_text(json.dumps(split))
    assert main([str(config), "--out", str(tmp_path / "out")]) == 2
    for number in (3, 4, 9):
        message = message.replace(f"case_{number:02d}", names[number])
    assert message in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize("side", ["validation", "test"])
def test_refuses_a_split_with_a_group_on_two_sides(tmp_path, capsys, side: str) -> None:
    config = write_inputs(tmp_path)
    frames = drawn_frames(12, empty=1)
    split = json.loads((tmp_path / "split.json").read_text())
    groups = list(frames.groups)
    groups[frames.case_ids.index(split[side][0])] = groups[frames.case_ids.index(split["train"][0])]
    dataclasses.replace(frames, groups=tuple(groups)).save(tmp_path / "frames.npz")
    assert main([str(config), "--out", str(tmp_path / "out")]) == 2
    assert f"on one side, received it in train and in {side}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_refuses_a_file_that_is_no_mapping(tmp_path, capsys) -> None:
    (tmp_path / "config.yaml").write_text("- 1\n")
    assert main([str(tmp_path / "config.yaml"), "--out", str(tmp_path)]) == 2
    assert "expected a YAML mapping, received list" in capsys.readouterr().err
    assert main([str(tmp_path / "none.yaml"), "--out", str(tmp_path)]) == 2
    assert "none.yaml: expected a YAML file" in capsys.readouterr().err


def test_the_bare_machine_has_the_whole_standard_library() -> None:
    # sysconfig reads a module named after the platform, which Python does not list among its own.
    program = (
        f"import sys; sys.path.insert(0, {str(MACHINE.parent)!r})\n"
        "import training_machine; training_machine.restrict()\n"
        "import sysconfig; sys.exit(0 if sysconfig.get_config_var('EXE') is not None else 1)"
    )
    assert subprocess.run([sys.executable, "-c", program]).returncode == 0


def test_a_number_in_scientific_notation_is_a_number(tmp_path) -> None:
    config = write_inputs(tmp_path)
    text = config.read_text()
    assert "learning_rate: 0.01" in text
    config.write_text(text.replace("learning_rate: 0.01", "learning_rate: 1e-2"))
    assert TrainingPlan.read(config).training.trainer.learning_rate == 0.01


def test_a_folder_that_can_not_be_written_is_refused_before_training(tmp_path, capsys) -> None:
    config = write_inputs(tmp_path)
    (tmp_path / "file").write_text("")
    assert main([str(config), "--out", str(tmp_path / "file")]) == 2
    said = capsys.readouterr()
    assert "--out: expected a folder that can be written" in said.err and "epoch" not in said.out
