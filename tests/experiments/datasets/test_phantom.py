"""The phantom as a data set: groups, repeatability, cache."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments import registry
from experiments.cli import compose_sweep
from experiments.datasets.phantom import Phantom
from experiments.datasets.sweep_cache import SweepRecipe, sweep_hash
from experiments.errors import InputError
from registration.phantom.scan import simulate_sweep


def small(tmp_path: Path, **changes: object) -> Phantom:
    settings = {"sweeps": 2, "frames_per_sweep": 3, "size_px": 64, "subset": "vein", "cache": str(tmp_path)}
    return Phantom(**{**settings, **changes})  # type: ignore[arg-type]


def test_frames_are_grouped_by_sweep_and_marked_simulated(tmp_path: Path) -> None:
    frames = small(tmp_path)()
    assert frames.simulated
    assert len(frames) == 6
    assert frames.groups == ("vein-sweep0",) * 3 + ("vein-sweep1",) * 3
    assert len(set(frames.case_ids)) == 6
    assert frames.images[0].shape == (64, 64)
    assert frames.spacing_mm[0] == pytest.approx((40 / 64, 40 / 64))
    assert all(mask.any() for mask in frames.masks)


def test_all_gives_the_three_phantoms(tmp_path: Path) -> None:
    frames = small(tmp_path, subset="all", sweeps=1, frames_per_sweep=2)()
    assert frames.groups == ("artificial-sweep0",) * 2 + ("vein-sweep0",) * 2 + ("artery-sweep0",) * 2


def test_second_call_reads_the_same_bytes_without_simulating(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = small(tmp_path)()
    monkeypatch.setattr(
        "experiments.datasets.sweep_cache.fill_cache", lambda *_: pytest.fail("simulated again")
    )
    second = small(tmp_path)()
    for one, other in zip(first.images + first.masks, second.images + second.masks, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_damaged_cache_entry_is_made_again(tmp_path: Path) -> None:
    # A copy, because the frames themselves are mapped from the file that is damaged here.
    before = small(tmp_path, sweeps=1)().images[1].copy()
    entry = next(tmp_path.glob("*/images.npy"))
    entry.write_bytes(entry.read_bytes()[:200])
    second = small(tmp_path, sweeps=1)()
    np.testing.assert_array_equal(before, second.images[1])


def test_several_processes_make_the_same_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("experiments.datasets.sweep_cache.WORTH_A_PROCESS", 1)
    alone, shared = small(tmp_path / "a")(), small(tmp_path / "b", workers=2)()
    for one, other in zip(alone.images + alone.masks, shared.images + shared.masks, strict=True):
        np.testing.assert_array_equal(one, other)


def test_every_setting_has_its_own_entry(tmp_path: Path) -> None:
    base = small(tmp_path).settings_of("vein")
    others = [
        small(tmp_path, seed=1).settings_of("vein"),
        small(tmp_path, size_px=72).settings_of("vein"),
        small(tmp_path, frames_per_sweep=4).settings_of("vein"),
        small(tmp_path).settings_of("artery"),
    ]
    recipes = [SweepRecipe(base, 1), *(SweepRecipe(settings, 0) for settings in [base, *others])]
    assert len({sweep_hash(recipe) for recipe in recipes}) == 6


def test_later_sweeps_are_the_same_whatever_else_is_made(tmp_path: Path) -> None:
    both, second = small(tmp_path / "a")(), small(tmp_path / "b", sweeps=1, first_sweep=1)()
    np.testing.assert_array_equal(both.images[4], second.images[1])
    assert second.groups[0] == "vein-sweep1"


def test_the_shipped_configuration_builds(tmp_path: Path) -> None:
    ((config, _),) = compose_sweep(["study=segmentation", "dataset=phantom", "seed=3"])
    built = registry.build(config["dataset"])
    assert isinstance(built, Phantom) and built.seed == 3
    for name in ("artificial", "vein", "artery"):
        ((config, _),) = compose_sweep(["study=simulate", f"phantom={name}", "seed=3"])
        settings = registry.build(config["phantom"])
        assert settings.subset == name and settings.seed == 3


@pytest.mark.parametrize(
    "setting", [{"subset": "liver"}, {"sweeps": 0}, {"frames_per_sweep": 1}, {"size_px": 8}, {"workers": 0}]
)
def test_bad_settings_are_named(setting: dict) -> None:
    with pytest.raises(InputError, match=next(iter(setting))):
        Phantom(**setting)


def test_the_cache_holds_the_frames_of_the_whole_sweep(tmp_path: Path) -> None:
    dataset = small(tmp_path, sweeps=1)
    frames = dataset()
    whole = simulate_sweep(dataset.settings_of("vein"), 0)
    np.testing.assert_array_equal(np.stack(frames.images), whole.sweep.images)
    np.testing.assert_array_equal(np.stack(frames.masks), whole.masks)
