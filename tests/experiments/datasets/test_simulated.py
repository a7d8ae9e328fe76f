"""Stand-ins are simulated, repeatable, kept on disk, and made only when asked for."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from drawn_sweeps import draw_sweeps

from experiments import registry
from experiments.cli import compose_sweep
from experiments.datasets.carotid import Carotid
from experiments.datasets.musv import MusV
from experiments.datasets.san_raffaele import SanRaffaele
from experiments.datasets.simulated import SimulatedSubstitute, variation_note
from experiments.datasets.usgra import Usgra
from experiments.errors import InputError
from registration.errors import InputError as PhantomInputError

REAL_SETS = ("carotid", "musv_artery", "musv_vein", "san_raffaele", "usgra")


def small(tmp_path: Path, **changes: object) -> SimulatedSubstitute:
    settings = {"subjects": 2, "recordings": 1, "frames": 2, "size_px": 32, "cache": str(tmp_path)}
    return SimulatedSubstitute(**{**settings, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", REAL_SETS)
def test_every_real_set_reads_unless_asked_to_simulate(name: str, tmp_path) -> None:
    ((config, _),) = compose_sweep(["study=segmentation", f"dataset={name}", "seed=3"])
    dataset = registry.build({**config["dataset"], "root": str(tmp_path / "none")})
    assert dataset.substitute.seed == 3
    assert not dataset.simulate and dataset.name.startswith(name)
    with pytest.raises(InputError, match=r"found no folder .*none; pass dataset\.root="):
        dataset()
    with pytest.raises(InputError, match=r"found no folder .*none; pass dataset\.root="):
        dataset.require_root()


def test_simulated_substitutes_are_marked_and_the_same_from_the_cache(
    tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_sweeps(monkeypatch)
    maker = small(tmp_path)
    sets = [
        lambda maker: Carotid("none", simulate=True, substitute=maker),
        lambda maker: MusV("none", "vein", simulate=True, substitute=maker),
        lambda maker: Usgra("none", simulate=True, substitute=maker),
    ]
    first = [make(maker)() for make in sets]
    monkeypatch.setattr(
        "experiments.datasets.sweep_cache.fill_cache", lambda *_: pytest.fail("simulated again")
    )
    # One more process is another setting, so the frames come from the disk, not from this process's memory.
    second = [make(dataclasses.replace(maker, workers=2))() for make in sets]
    for one, other in zip(first, second, strict=True):
        assert one.simulated and one is not other and one.digest() == other.digest()
        assert all(spacing is not None for spacing in one.spacing_mm)


def test_usgra_has_groups_of_near_duplicates_and_no_nerve(tmp_path, monkeypatch) -> None:
    draw_sweeps(monkeypatch)
    dataset = Usgra("none", simulate=True, substitute=small(tmp_path, frames=3))
    frames = dataset()
    assert frames.case_ids == ("0000", "0001", "0002", "0003", "0004", "0005")
    assert frames.groups == ("near_duplicates_000",) * 3 + ("near_duplicates_001",) * 3
    assert dataset.notes()[0].startswith("Simulated: no image of usgra was used")
    with pytest.raises(InputError, match="target: expected vessel where simulate=true, received 'nerve'"):
        Usgra("none", target="nerve", simulate=True)


def test_subjects_have_vessels_of_their_own_and_sessions_scanners(tmp_path) -> None:
    maker = small(tmp_path, subjects=30)
    anatomies = [maker.recipe(subject, 0).settings.anatomy_seed for subject in range(30)]
    assert len(set(anatomies)) == 30 and max(anatomies) < 1000
    one, other = maker.recipe(0, 0).settings, maker.recipe(0, 1).settings
    assert one.anatomy_seed == other.anatomy_seed and one.scanner != other.scanner and one.seed != other.seed
    again = maker.recipe(0, 0, sweep=1)
    assert again.settings == one and again.number == 1
    assert maker.recipe(0, 0, times=4).settings.motion.frames == 8


def test_strength_scales_what_differs(tmp_path) -> None:
    def gains(strength: float) -> float:
        maker = small(tmp_path, strength=strength)
        return float(np.std([maker.recipe(0, session).settings.scanner.gain_db for session in range(20)]))

    assert gains(1.0) == pytest.approx(5 * gains(0.2), rel=1e-6) and gains(0.2) > 0


def test_a_poor_recording_is_darker_or_noisier(tmp_path) -> None:
    maker = small(tmp_path)
    good, poor = maker.recipe(0, 0).settings, maker.recipe(0, 0, poor=True).settings
    assert poor.artefacts.contact_loss_mm > 3 * good.artefacts.contact_loss_mm
    assert poor.artefacts.shadows > 3 * good.artefacts.shadows


def test_recordings_are_simulated_frames_with_their_masks(tmp_path) -> None:
    maker = small(tmp_path, size_px=64)
    (recorded,) = maker([maker.recipe(1, 0)])
    assert recorded.images.shape == recorded.masks.shape == (2, 64, 64)
    assert recorded.images.std() > 5 and all(0 < mask.sum() < 2000 for mask in recorded.masks)
    depth_mm = maker.recipe(1, 0).settings.scanner.depth_mm
    assert recorded.spacing_mm == pytest.approx((depth_mm / 64,) * 2)


def test_another_seed_is_other_subjects(tmp_path) -> None:
    one, other = (small(tmp_path, seed=seed).recipe(0, 0).settings for seed in (0, 1))
    assert one.anatomy_seed != other.anatomy_seed


@pytest.mark.parametrize(
    "setting",
    [{"subjects": 1}, {"recordings": 0}, {"frames": 1}, {"size_px": 8}, {"strength": 0}, {"strength": 2}],
)
def test_bad_settings_are_named(setting: dict) -> None:
    with pytest.raises(PhantomInputError, match=next(iter(setting))):
        SimulatedSubstitute(**setting)


def test_san_raffaele_varies_and_marks_poor_sessions(tmp_path, monkeypatch) -> None:
    draw_sweeps(monkeypatch)
    maker = small(tmp_path, subjects=4, recordings=2)
    dataset = SanRaffaele("none", subset="pruned", blocks=2, gap_frames=1, simulate=True, substitute=maker)
    frames, sessions = dataset(), dataset.report()["sessions"]
    assert frames.simulated and list(sessions["frames"]) == [8] + [2] * 7
    assert list(sessions["excluded"] > 0) == [False, False, False, True, False, False, True, False]
    assert len(set(frames.spacing_mm)) > 3


def test_what_differs_between_recordings_is_stated_with_its_range(tmp_path) -> None:
    maker = small(tmp_path)
    recipes = [maker.recipe(subject, subject) for subject in (0, 1)]
    depths_mm = sorted(recipe.settings.scanner.depth_mm for recipe in recipes)
    said = variation_note(recipes)
    assert said.startswith("Varied between the 2 simulated recordings: vessel shape (2 anatomies), tissue")
    assert f"imaging depth {depths_mm[0]:.3g} to {depths_mm[1]:.3g} mm" in said
    # What both have alike is not varied.
    assert "without contact" not in said and "shadows" not in said
    poor = [*recipes, maker.recipe(1, 2, poor=True)]
    assert "width without contact 4 to 14 mm, hard spots that cast shadows 4 to 16" in variation_note(poor)
    alone = variation_note([recipes[0]])
    assert "vessel shape (1 anatomies)" in alone and "imaging depth" not in alone


def test_notes_of_simulated_sessions_and_sequences_say_what_was_varied(tmp_path, monkeypatch) -> None:
    draw_sweeps(monkeypatch)
    maker = small(tmp_path, subjects=4)
    for dataset in (
        SanRaffaele("none", simulate=True, substitute=maker),
        MusV("none", "vein", simulate=True, substitute=maker),
    ):
        assert any(note.startswith("Varied between the ") for note in dataset.notes())
