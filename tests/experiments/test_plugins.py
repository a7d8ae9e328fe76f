"""A network, a rigid method, a data set and a study from outside: a plugin's package and a folder of configurations."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from vessels import bent_tube

from experiments import plugins, registry
from experiments.cli import compose_sweep, main
from experiments.command_line.help_page import help_text
from experiments.errors import InputError
from experiments.running import jobs
from models.checkpoint import Checkpoint
from models.networks.registry import recipe_of, recipes
from models.plugins import package_folder, plugin_packages
from models.preprocessing import Preprocessing
from registration.io.surfaces import write_surface

NETWORK = '''
"""One convolution over the image."""
from dataclasses import dataclass
from typing import ClassVar
from torch import nn

@dataclass(frozen=True)
class OneLayer:
    kernel_px: int = 3
    name: ClassVar[str] = "one_layer"

    @property
    def multiple(self) -> int:
        return 1

    def __call__(self) -> nn.Module:
        return nn.Conv2d(1, 1, self.kernel_px, padding=self.kernel_px // 2)
'''
RIGID = '''
"""The two centroids brought together."""
from dataclasses import dataclass
import numpy as np
from registration import transforms
from registration.rigid.result import Candidate, RigidResult

@dataclass(frozen=True)
class Centroids:
    keep: float = 1.0

    def __call__(self, moving_mm, fixed_mm, initial=None, *, search_cone=None, moving_centerline_mm=None,
                 fixed_centerline_mm=None, moving_frame=None):
        pose = transforms.translation(np.mean(fixed_mm, axis=0) - np.mean(moving_mm, axis=0))
        return RigidResult(pose, 1.0, 1.0, 1.0, 1, True, (Candidate(pose, 1.0, 0, 1, "only"),), 0.0)
'''
DATASET = '''
"""Discs on a grey ground."""
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from models.labelled_frames import LabelledFrames

@dataclass(frozen=True)
class Discs:
    count: int = 6
    name: ClassVar[str] = "discs"

    def __call__(self) -> LabelledFrames:
        down, right = np.mgrid[:32, :32]
        masks = tuple((down - 12 - i) ** 2 + (right - 16) ** 2 < 49 for i in range(self.count))
        images = tuple((60 + 120 * mask).astype(np.uint8) for mask in masks)
        names = tuple(str(i) for i in range(self.count))
        return LabelledFrames(images, masks, names, names, ((0.5, 0.5),) * self.count, True)
'''
STUDY = '''
"""How large the vessel is in the masks of a data set."""
import pandas as pd
from experiments.datasets.protocol import DataSet
from experiments.outcome import JobResult, Outcome

def jobs(config):
    return [{"part": part} for part in config["parts"]]

def run(*, dataset: DataSet, part: int) -> Outcome:
    masks = dataset().masks[part::2]
    cases = pd.DataFrame({"case_id": [f"{part}-{i}" for i in range(len(masks))], "pixels": [m.sum() for m in masks]})
    return Outcome(metrics={"pixels_mean": float(cases["pixels"].mean())}, cases=cases)

def summarise(results: list[JobResult]) -> Outcome:
    cases = pd.concat([result.cases for result in results], ignore_index=True)
    return Outcome(metrics={"pixels_mean": float(cases["pixels"].mean())}, cases=cases, findings=("measured",))
'''
FILES = {
    "__init__.py": '"""A plugin."""\nfrom pathlib import Path\n',
    "networks.py": NETWORK,
    "centroids.py": RIGID,
    "discs.py": DATASET,
    "studies/__init__.py": "",
    "studies/vessel_size.py": STUDY,
    "conf/model/one_layer.yaml": "# One layer.\n_target_: toy_vessels.networks.OneLayer\nkernel_px: 3\n",
    "conf/rigid/centroids.yaml": "# Centroids.\ncentroids:\n  _target_: toy_vessels.centroids.Centroids\n  keep: 1.0\n",
    "conf/dataset/discs.yaml": "# Discs.\n_target_: toy_vessels.discs.Discs\ncount: 6\n",
    "conf/study/vessel_size.yaml": (
        "# @package _global_\n# How large the vessel is in the masks.\n"
        "defaults:\n  - /dataset: discs\n  - _self_\n\nparts: [0, 1]\npart: null\n"
    ),
}


def install(site: Path, package: str, value: str | None = None) -> None:
    """Write what pip leaves of a distribution: its record with the entry point."""
    record = site / f"{package}-1.0.dist-info"
    record.mkdir(parents=True)
    (record / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (record / "entry_points.txt").write_text(f"[ctus.plugins]\n{package} = {value or package}\n")


@pytest.fixture
def plugin(tmp_path: Path, home: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of an installed plugin's package ``toy_vessels``."""
    site = tmp_path / "site"
    for name, text in FILES.items():
        path = site / "toy_vessels" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    install(site, "toy_vessels")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", f"{site}:{':'.join(filter(None, sys.path))}")
    yield site / "toy_vessels"
    for name in [name for name in sys.modules if name.split(".")[0] == "toy_vessels"]:
        del sys.modules[name]


def test_a_plugin_is_found_by_its_entry_point_without_being_imported(plugin: Path) -> None:
    assert plugin_packages() == ("toy_vessels",)
    assert package_folder("toy_vessels") == plugin
    assert plugins.config_folders()[-1] == plugin / "conf"
    assert "toy_vessels" not in sys.modules
    assert "vessel_size" in jobs.study_names()
    assert "How large the vessel is in the masks." in help_text(["--help"])
    assert "parts: [0, 1]" in help_text(["study=vessel_size", "--help"])


def test_without_its_entry_point_nothing_of_a_package_is_taken(plugin: Path) -> None:
    (plugin.parent / "toy_vessels-1.0.dist-info" / "entry_points.txt").unlink()
    sys.path.append(str(plugin / "conf"))  # another path is another look
    try:
        assert plugin_packages() == ()
        with pytest.raises(InputError, match="registry"):
            registry.load("toy_vessels.discs.Discs")
        with pytest.raises(InputError, match="study: expected one of"):
            compose_sweep(["study=vessel_size"])
    finally:
        sys.path.remove(str(plugin / "conf"))


def test_only_frozen_dataclasses_that_a_plugin_defines_may_be_named(plugin: Path) -> None:
    assert registry.build({"_target_": "toy_vessels.discs.Discs", "count": 3})().groups == ("0", "1", "2")
    for target in ("toy_vessels.Path", "toy_vessels.studies.vessel_size.run", "toy_vessels.discs.np.save"):
        with pytest.raises(InputError, match="registry"):
            registry.load(target)


def test_a_network_from_outside_composes_and_is_kept_in_a_checkpoint(plugin: Path, tmp_path: Path) -> None:
    ((config, _),) = compose_sweep(["study=segmentation", "model=one_layer", "model.kernel_px=5"])
    recipe = registry.build(config["model"], "model")
    assert recipes()["one_layer"] is type(recipe)
    assert recipe_of("one_layer", {"kernel_px": 5}) == recipe
    Checkpoint(recipe, recipe().state_dict(), Preprocessing(8)).save(tmp_path / "model.pt")
    network = Checkpoint.load(tmp_path / "model.pt").network()
    assert network(torch.zeros(1, 1, 8, 8)).shape == (1, 1, 8, 8)


def test_a_rigid_method_from_outside_registers_two_files(plugin: Path, home: Path) -> None:
    write_surface(home / "fixed.ply", bent_tube())
    call = [
        "study=register",
        f"moving={home / 'fixed.ply'}",
        f"fixed={home / 'fixed.ply'}",
        "rigid=centroids",
    ]
    assert main([*call, f"out={home / 'out'}", "tracking.enabled=false"]) == 0
    assert (home / "out" / "registration.json").is_file()


@pytest.mark.parametrize("at_once", [1, 2])
def test_a_study_and_a_data_set_from_outside_run_in_this_process_and_in_others(
    plugin: Path, home: Path, at_once: int, capsys: pytest.CaptureFixture[str]
) -> None:
    out = home / "out"
    call = [
        "study=vessel_size",
        "dataset.count=4",
        f"jobs={at_once}",
        f"out={out}",
        "tracking.enabled=false",
    ]
    assert main(call) == 0, capsys.readouterr().err
    cases = pd.read_parquet(out / "cases.parquet")
    # Whole discs of radius below 7 pixels: 145 pixels each.
    assert list(cases["case_id"]) == ["0-0", "0-1", "1-0", "1-1"]
    assert np.all(cases["pixels"] == 145)
    assert "measured" in capsys.readouterr().out


def test_a_folder_of_ones_own_adds_options_of_every_kind(plugin: Path, tmp_path: Path) -> None:
    own = tmp_path / "own"
    for group, text in (
        (
            "model",
            "_target_: models.networks.unet.UNet\nwidth: 4\ndepth: 2\nnormalisation: none\ndropout: 0.0\n",
        ),
        ("dataset", "_target_: toy_vessels.discs.Discs\ncount: 3\n"),
    ):
        (own / group).mkdir(parents=True)
        (own / group / "mine.yaml").write_text(text)
    words = ["study=segmentation", "model=mine", "dataset=mine"]
    ((config, _),) = compose_sweep(words, config_dir=str(own))
    assert (config["model"]["width"], config["dataset"]["count"]) == (4, 3)
    assert "kernel_px" not in help_text([*words, "--config-dir", str(own)])


def test_an_entry_point_without_a_package_is_refused_in_one_sentence(
    plugin: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    install(tmp_path / "other", "broken_toy", "no_such_package_anywhere")
    monkeypatch.syspath_prepend(str(tmp_path / "other"))
    assert main(["study=vessel_size"]) == 2
    assert "entry point ctus.plugins: expected an installed package" in capsys.readouterr().err
