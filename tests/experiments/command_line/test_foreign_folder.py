"""A folder of configurations sets settings of studies and values of a sweep; nothing else of Hydra's, in no way."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.cli import main
from experiments.command_line.foreign_folder import require_harmless_folder
from experiments.errors import InputError

CALLBACK = "hydra:\n  callbacks:\n    x:\n      _target_: pathlib.Path.touch\n"


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_settings_and_values_of_a_sweep_pass(tmp_path: Path) -> None:
    write(
        tmp_path / "dataset" / "mine.yaml", "_target_: experiments.datasets.folder.Folder\nroot: hydrangea\n"
    )
    write(
        tmp_path / "preset" / "p.yaml",
        "# @package _global_\nhydra:\n  sweeper:\n    params:\n      seed: 1,2\n",
    )
    write(
        tmp_path / "preset" / "q.yaml", "# @package _global_\ndefaults:\n  - override /model: unet\nseed: 3\n"
    )
    write(tmp_path / "notes.txt", CALLBACK)
    require_harmless_folder(tmp_path)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("preset/a.yaml", f"# @package _global_\n{CALLBACK}"),
        ("preset/a.yaml", CALLBACK),
        ("hydra/callbacks/a.yaml", "x: 1\n"),
        ("hydra/a.yaml", "x: 1\n"),
        ("a.yaml", "# @package hydra\ncallbacks: {}\n"),
        ("dataset/a.yaml", "# @package hydra.callbacks.x\n_target_: torch.load\n"),
        ("dataset/a.yaml", "#@package hydra\nx: 1\n".replace("#@", "# @")),
        ("preset/a.yaml", "defaults:\n  - override /hydra/launcher: joblib\n"),
        ("preset/a.yaml", "defaults:\n  - /dataset@hydra.callbacks.x: usgra\n"),
        ("preset/a.yaml", "defaults:\n  - dataset/usgra@hydra.callbacks.x\n"),
        (
            "preset/a.yaml",
            "# @package _global_\nhydra: {sweeper: {params: {+hydra.callbacks.x._target_: a}}}\n",
        ),
        ("preset/a.yaml", "# @package _global_\nhydra: {sweeper: {params: {seed: 1}, _target_: a}}\n"),
        ("preset/a.yaml", "# @package _global_\nhydra: {searchpath: [pkg://os]}\n"),
        ("preset/a.yaml", "# @package _global_\nx: &x {hydra: {callbacks: {}}}\n<<: *x\n"),
        ("preset/a.yaml", "# @package _global_\nhydra.callbacks: {}\n"),
    ],
)
def test_everything_else_of_hydras_is_refused_with_the_file(tmp_path: Path, name: str, text: str) -> None:
    write(tmp_path / name, text)
    with pytest.raises(InputError, match=rf"--config-dir: .*{name}: expected settings of studies"):
        require_harmless_folder(tmp_path)


def test_linked_folders_are_looked_into_and_circles_end(tmp_path: Path) -> None:
    write(tmp_path / "other" / "a.yaml", CALLBACK)
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "circle").symlink_to(tmp_path / "own")
    require_harmless_folder(tmp_path / "own")
    (tmp_path / "own" / "preset").symlink_to(tmp_path / "other")
    with pytest.raises(InputError, match="Hydra's own"):
        require_harmless_folder(tmp_path / "own")


def test_files_that_are_no_yaml_or_grow_are_refused(tmp_path: Path) -> None:
    for text in ("a: [", "a: &a {b: *a}\n", "[" * 3000):
        write(tmp_path / "a.yaml", text)
        with pytest.raises(InputError, match=r"a\.yaml: expected a YAML file"):
            require_harmless_folder(tmp_path)


def test_no_callback_of_a_foreign_folder_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = tmp_path / "made"
    text = "# @package _global_\nhydra:\n  callbacks:\n    x:\n      _target_: pathlib.Path.touch\n"
    text += f"      self: '{made}'\n"
    write(tmp_path / "own" / "preset" / "a.yaml", text)
    words = ["study=export_runs", "+preset=a", "--config-dir", str(tmp_path / "own")]
    for more in ([], ["--cfg", "job"], ["--info", "config"], ["--hydra-help"]):
        assert main([*words, *more]) == 2
        assert "Hydra's own" in capsys.readouterr().err
