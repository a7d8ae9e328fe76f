"""The command line: help at once, every configuration composes and builds, every mistake is one sentence."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import hydra
import pytest
from omegaconf import DictConfig

from experiments import cli
from experiments.cli import compose_sweep, main
from experiments.errors import InputError


def test_help_names_every_study_with_its_sentence(capsys, repository: Path) -> None:
    assert main(["--help"]) == 0
    page = capsys.readouterr().out
    for path in (repository / "conf" / "study").glob("*.yaml"):
        lines = path.read_text().splitlines()
        assert lines[0] == "# @package _global_", path
        assert lines[1].startswith("# "), path
        assert f"{path.stem} " in page
        assert lines[1][2:] in page
    for path in (repository / "conf" / "preset").glob("*.yaml"):
        assert f"+sweep={path.stem}  " + path.read_text().splitlines()[1][2:] in page


def test_help_of_a_study_shows_its_settings(capsys) -> None:
    assert main(["study=import_runs", "--help"]) == 0
    assert "archive: ${project:results/runs}" in capsys.readouterr().out


def test_help_imports_nothing_heavy(repository: Path) -> None:
    program = (
        "import sys; from experiments.cli import main; main(['--help'])\n"
        "heavy = {'hydra', 'torch', 'mlflow', 'open3d', 'lightning', 'monai', 'numpy', 'pandas', 'rich'}\n"
        "sys.exit(','.join(sorted(heavy & set(sys.modules))) or 0)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(repository / "src")},
    )
    assert ended.returncode == 0, ended.stderr


def test_no_words_show_the_help_and_exit_with_2(capsys) -> None:
    assert main([]) == 2
    assert "study=<name>" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["study=nonsense"], "study: expected one of"),
        (["study=nonsense", "--help"], "study: expected one of"),
        (["seed=1"], "study: expected one of"),
        (["study=import_runs", "colour=red"], "Could not override 'colour': expected a setting of the study"),
        (["study=import_runs", "seed=1,2"], "seed: expected -m (--multirun) before"),
        (["study=import_runs", "seed"], "seed: expected setting=value"),
        (["study=import_runs", "archive=a=b"], """archive=a=b: expected setting=value"""),
        (["study=register"], "expected a value for"),
        (
            ["register", "moving=x"],
            "received a word without =; did you mean study=register?",
        ),
        (["study=regster"], "did you mean register?"),
        (["doctr"], "received a word without =; did you mean ctus doctor?"),
        (["=1"], "=1: expected setting=value, received a word without a setting's name"),
        (["study=register", "+=1"], "+=1: expected setting=value, received a word without a setting's name"),
        (["study=register", "~"], "~: expected setting=value, received a word without a setting's name"),
        (["study=register", ""], "'': expected setting=value, received a word without a setting's name"),
        (["study=Register"], "did you mean register?"),
        (["study=register", "rigid=CPD"], "did you mean cpd_rigid?"),
        (["study=register", "rigid=Single-ICP"], "did you mean single_icp?"),
        (["studi=register"], "did you mean study?"),
        (["study=register", "movin=x"], "did you mean moving?"),
        (["study=segmentation", "trainer.max_epoch=3"], "did you mean trainer.max_epochs?"),
        (["study=segmentation", "batch_sise=3"], "did you mean trainer.batch_size?"),
        (["study=segmentation", "model=unnet"], "received 'unnet'; did you mean unet?"),
        (["study=segmentation", "+model.widht=8"], "received widht; did you mean width?"),
        (
            ["study=register", "moving=a", "fixed=b", "rigid=[multistart,gcip]"],
            "received 'gcip'; did you mean gicp?",
        ),
        (
            ["study=simulate", "phantom=null"],
            "expected one of artery, artificial, random, vein, received null",
        ),
        (["-m", "study=import_runs", "seed=range(3,0)"], "seed: expected at least one value to sweep over"),
        (["-m", "study=import_runs", "seed=range(0,3,0)"], "received what can't be read: range() arg 3"),
        (
            ["-m", "study=segmentation", "model=glob(zzz*)"],
            "model: expected at least one value to sweep over",
        ),
        (
            ["study=segmentation", "trainer.batch_size=1.5"],
            "trainer.batch_size: expected a whole number, received 1.5",
        ),
        (
            ["study=segmentation", "trainer.max_epochs=null"],
            "max_epochs: expected a whole number, received null",
        ),
        (["study=register", "moving=a", "fixed="], "fixed: expected a path, received an empty one"),
        (["study=segmentation", "dataset=usgra", "dataset.root="], "dataset.root: expected a path, received"),
        (["study=evaluate", "prediction= ", "reference=a"], "prediction: expected a path, received an empty"),
        (["study=register", "moving=.", "fixed=b"], "moving: .: expected a file, received a folder"),
        (["study=register", "moving=a", "fixed=b", "~moving"], "study=register: expected a value for moving"),
        (["study=segmentation", "~dataset"], "study=segmentation: expected a value for dataset"),
        (["study=register", "moving=a", "fixed=b", "keep=high"], "keep: expected a number, received 'high'"),
        (["study=import_runs", "--config-dir", "/no/such/folder"], "--config-dir: expected a folder"),
        (["--multirn", "study=import_runs"], "did you mean --multirun?"),
        (["--config-name", "x", "study=import_runs"], "--config-name: expected one of"),
        (["study=import_runs", "--cfg", "jb"], "invalid choice: 'jb'"),
        (["study=import_runs", "nonsense=1", "--cfg", "job"], "Could not override 'nonsense'"),
    ],
)
def test_a_mistake_is_one_sentence_and_exits_with_2(words: list[str], sentence: str, capsys) -> None:
    assert main(words) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert "Traceback" not in said


def test_a_mistake_is_found_before_any_file_is_read_whole(home: Path, capsys, monkeypatch) -> None:
    """A folder where a file belongs may be one of gigabytes."""
    from experiments.running import jobs

    read: list[Path] = []
    monkeypatch.setattr(jobs, "content_digest", lambda path, _: read.append(path))
    (home / "large").mkdir()
    assert main(["study=register", f"moving={home / 'large'}", "fixed=b.ply"]) == 2
    assert "expected a file, received a folder" in capsys.readouterr().err
    assert read == []


def test_a_wrong_option_exits_with_2(capsys) -> None:
    assert main(["--nonsense"]) == 2
    assert "--nonsense" in capsys.readouterr().err


def test_a_seed_of_zero_is_kept_and_paths_are_the_projects(home: Path) -> None:
    ((config, label),) = compose_sweep(["study=export_runs", "seed=0"])
    assert config["seed"] == 0
    assert config["study"] == "export_runs"
    assert config["archive"] == str(home / "results" / "runs")
    assert label == ""


def test_a_sweep_is_every_combination_labelled_by_what_varies() -> None:
    points = compose_sweep(["study=export_runs", "seed=0,1", "resume=true,false", "out=x"], multirun=True)
    assert [label for _, label in points] == [
        "seed=0,resume=True",
        "seed=0,resume=False",
        "seed=1,resume=True",
        "seed=1,resume=False",
    ]
    assert [config["seed"] for config, _ in points] == [0, 0, 1, 1]


def test_a_users_own_config_folder_adds_options(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    (tmp_path / "tracking").mkdir()
    (tmp_path / "tracking" / "lab.yaml").write_text("uri: http://tracker.example\n")
    ((config, _),) = compose_sweep(["study=export_runs", "+tracking=lab"], config_dir=str(tmp_path))
    assert config["tracking"]["uri"] == "http://tracker.example"


def test_an_unknown_interpolation_is_refused() -> None:
    with pytest.raises(InputError, match="nowhere"):
        compose_sweep(["study=export_runs", "archive=${nowhere}"])


def test_the_version_is_that_of_the_package(capsys) -> None:
    from importlib import metadata

    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"ctus {metadata.version('ctus')}\n"


@pytest.mark.parametrize(
    "words",
    [
        ["study=register", "moving=a", "fixed=b", "seed=0,1", "keep=0.5,0.7"],
        ["study=register", "moving=a", "fixed=b", "rigid=multistart,single_icp", "seed=0,1"],
        ["study=register", "moving=a", "fixed=b", "~slicer", "+tracking.more=1,2", "++seed=3"],
        ["study=register", "moving=a", "fixed=b", "+spare={max_tre_mm:3.0}", "seed=0,1"],
    ],
)
def test_points_are_what_hydra_composes_for_each(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """What points have in common is composed once; their own values are set afterwards."""
    points = compose_sweep(words, multirun=True)
    assert len(points) > 1
    for config, label in points:
        varying = [word.partition("=")[0] for word in label.split(",")]
        kept = [word for word in words if word.partition("=")[0] not in varying]
        ((alone, _),) = compose_sweep([*kept, *label.split(",")])
        with monkeypatch.context() as patch:
            patch.setattr(cli._Composer, "__call__", lambda _, given: by_hydra(given))
            ((known, _),) = compose_sweep([*kept, *label.split(",")])
        ours, own, theirs = (
            {**each, "call": {**each["call"], "command": ""}} for each in (config, alone, known)
        )
        assert own == theirs
        assert sorted(ours["call"].pop("settings")) == sorted(theirs["call"].pop("settings"))
        assert ours == theirs


def by_hydra(words: list[str]) -> DictConfig:
    """One call, composed by Hydra alone."""
    return hydra.compose("config", words, return_hydra_config=True)


def test_what_was_composed_before_is_composed_again_once_a_file_has_changed(tmp_path: Path) -> None:
    (tmp_path / "tracking").mkdir()
    words = ["study=export_runs", "+tracking=lab"]
    for address in ("http://lab:5000", "http://other:50000"):
        (tmp_path / "tracking" / "lab.yaml").write_text(f"# @package tracking\nuri: {address}\n")
        for _ in range(2):
            ((config, _),) = compose_sweep(words, config_dir=str(tmp_path))
            assert config["tracking"]["uri"] == address
    (tmp_path / "tracking" / "lab.yaml").unlink()
    with pytest.raises(InputError, match="lab"):
        compose_sweep(words, config_dir=str(tmp_path))


@pytest.mark.parametrize("group", ["sweep", "preset"])
def test_a_preset_has_one_name_in_the_command_that_is_kept(group: str) -> None:
    points = compose_sweep([f"+{group}=robustness_small", "target=a.ply"], multirun=True)
    assert {config["call"]["command"] for config, _ in points} == {
        "ctus -m +sweep=robustness_small target=a.ply"
    }


def test_what_one_call_sets_is_not_there_in_the_next() -> None:
    words = ["study=register", "moving=a", "fixed=b"]
    ((first, _),) = compose_sweep(words)
    ((changed, _),) = compose_sweep([*words, "seed=7", "~slicer", "+more=1", "tracking.uri=http://lab:5000"])
    ((again, _),) = compose_sweep(words)
    assert first == again != changed


def test_a_users_own_option_in_a_sweep_is_an_option(tmp_path: Path) -> None:
    (tmp_path / "tracking").mkdir()
    (tmp_path / "tracking" / "lab.yaml").write_text("# @package tracking\n# Ours.\nuri: http://lab:5000\n")
    words = ["study=export_runs", "tracking=lab", "seed=0,1"]
    points = compose_sweep([*words[:1], f"+{words[1]}", *words[2:]], config_dir=str(tmp_path), multirun=True)
    assert [config["tracking"]["uri"] for config, _ in points] == ["http://lab:5000"] * 2


def test_options_of_a_search_path_of_hydras_are_options(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "one.yaml").write_text("x: 1\n")
    words = ["study=export_runs", f"hydra.searchpath=[file://{tmp_path}]", "+mine=one"]
    for more, multirun in (([], False), (["seed=0,1"], True)):
        for config, _ in compose_sweep([*words, *more], multirun=multirun):
            assert config["mine"] == {"x": 1}


def test_a_mistake_in_one_of_two_points_of_one_job_is_found_before_a_run_exists(home: Path, capsys) -> None:
    """What a job only uses, like the number of its workers, is no part of what it is: the first point counts."""
    words = ["-m", "study=robustness", "rigid=[single_icp]", "trials=2", "overlaps=[1.0]", "dry_run=true"]
    (home / "a.ply").write_text("ply\n")
    assert main([*words, f"target={home / 'a.ply'}", "workers=-3,1"]) == 2
    assert "workers: expected a whole number of at least 1, received -3" in capsys.readouterr().err


def test_a_wrong_setting_among_the_values_of_a_sweep_is_named() -> None:
    with pytest.raises(InputError, match=r"did you mean keep"):
        compose_sweep(["study=register", "moving=a", "fixed=b", "keeps=1,2"], multirun=True)


def test_every_point_of_a_sweep_is_shown(capsys) -> None:
    import yaml

    assert main(["study=import_runs", "--cfg", "job", "-m", "seed=range(1,3)"]) == 0
    shown = list(yaml.safe_load_all(capsys.readouterr().out))
    assert [point["seed"] for point in shown] == [1, 2]
    assert main(["study=import_runs", "seed=5", "--cfg", "job"]) == 0
    (one,) = yaml.safe_load_all(capsys.readouterr().out)
    assert one["seed"] == 5 and "hydra" not in one


def test_a_sweep_over_the_options_of_a_pattern() -> None:
    points = compose_sweep(["study=segmentation", "model=glob(unet*)"], multirun=True)
    assert [label for _, label in points] == ["model=unet", "model=unet3plus"]


@pytest.mark.parametrize("place", [0, 1, 2])
@pytest.mark.parametrize("spelling", ["two words", "one word"])
def test_a_users_own_config_folder_before_between_and_after_other_words(
    place: int,
    spelling: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "own" / "tracking").mkdir(parents=True)
    (tmp_path / "own" / "tracking" / "lab.yaml").write_text("uri: http://tracker.example\n")
    monkeypatch.chdir(tmp_path)  # a relative folder is taken from the current one
    option = ["--config-dir", "own"] if spelling == "two words" else ["--config-dir=own"]
    words = ["study=export_runs", "+tracking=lab"]
    assert main([*words[:place], *option, *words[place:], "--cfg", "job"]) == 0
    assert "uri: http://tracker.example" in capsys.readouterr().out


@pytest.mark.parametrize("words", [["study=segmentation", "--help"], ["study=export_runs", "--cfg", "job"]])
def test_a_reader_that_stops_reading_is_no_error(repository: Path, words: list[str]) -> None:
    program = f"import sys; from experiments.cli import main; sys.exit(main({words}))"
    ended = subprocess.run(
        ["bash", "-c", f'set -o pipefail; "{sys.executable}" -c "{program}" | true'],
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(repository / "src")},
    )
    assert "Traceback" not in ended.stderr and "BrokenPipe" not in ended.stderr


@pytest.mark.parametrize("place", ["_run", "_print_version"])
def test_a_stop_by_the_keyboard_is_one_sentence_wherever_it_comes(place: str, monkeypatch, capsys) -> None:
    def stopped(*_: object, **__: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(f"experiments.cli.{place}", stopped)
    assert main(["--version"] if place == "_print_version" else ["study=export_runs"]) == 130
    assert capsys.readouterr().err == "Stopped by the keyboard.\n"
