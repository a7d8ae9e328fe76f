"""Sources of error on known masks and settings: each changes what it is to change, by as much as it says."""

from __future__ import annotations

import numpy as np
import pytest

from registration.errors import InputError
from registration.phantom.conditions import Deformation, Motion
from registration.phantom.error_sources import SOURCES, ErrorSources, shifted_borders
from registration.phantom.settings import PhantomSettings

ROW, COLUMN = np.mgrid[:80, :100]
DISC = np.hypot(ROW - 40, COLUMN - 50) <= 20
MASKS = np.stack([DISC] * 20)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_nothing_is_on_without_a_source_and_all_else_is_kept() -> None:
    phantom = PhantomSettings(motion=Motion(frames=12, latency_s=0.2, noise_mm=0.4))
    off = ErrorSources().settings_with(phantom, ())
    assert (off.motion.latency_s, off.motion.calibration_mm, off.tissue.sound_speed_m_s) == (0.0, 0.0, 1540.0)
    assert (off.deformation.bend_mm, off.deformation.pressure_mm) == (0.0, 0.0)
    assert (off.motion.frames, off.motion.noise_mm, off.ct.crop_mm) == (12, 0.4, phantom.ct.crop_mm)
    np.testing.assert_array_equal(ErrorSources().masks_with(MASKS, (), (0.2, 0.2), rng()), MASKS)


def test_each_source_changes_its_own_part() -> None:
    sources = ErrorSources(
        lag_s=0.1, calibration_mm=2.0, sound_speed_m_s=1450.0, deformation=Deformation(bend_mm=3.0)
    )
    phantom = PhantomSettings()
    off = sources.settings_with(phantom, ())
    changed = {
        source: [name for name in ("motion", "tissue", "ct", "deformation")
                 if getattr(sources.settings_with(phantom, {source}), name) != getattr(off, name)]
        for source in SOURCES
    }  # fmt: skip
    assert changed == {
        "mask_bias": [], "wall_loss": [], "lag": ["motion"], "calibration": ["motion"], "sound_speed": ["tissue"],
        "ct": ["ct"], "deformation": ["deformation"],
    }  # fmt: skip
    on = sources.settings_with(phantom, set(SOURCES))
    assert (on.motion.latency_s, on.motion.calibration_mm, on.tissue.sound_speed_m_s) == (0.1, 2.0, 1450.0)
    assert on.deformation.bend_mm == 3.0


@pytest.mark.parametrize("bias_mm", [-0.6, 0.4, 1.0])
def test_a_bias_moves_the_border_by_as_much_in_millimetres(bias_mm: float) -> None:
    spacing_mm = (0.2, 0.1)
    ellipse = np.hypot((ROW - 40) * 0.2, (COLUMN - 50) * 0.1) <= 3.0
    (shifted,) = shifted_borders(ellipse[None], bias_mm, 0.0, spacing_mm, rng())
    radius_mm = np.sqrt(shifted.sum() * 0.2 * 0.1 / np.pi)
    assert radius_mm == pytest.approx(3.0 + bias_mm, abs=0.15)


def test_random_borders_scatter_and_keep_the_mean() -> None:
    shifted = shifted_borders(MASKS, 0.0, 0.6, (0.2, 0.2), rng())
    areas = shifted.sum(axis=(1, 2)) / DISC.sum()
    assert areas.std() > 0.01
    assert areas.mean() == pytest.approx(1.0, abs=0.08)
    assert (shifted != MASKS).any(axis=(1, 2)).all()
    empty = np.zeros_like(MASKS)
    np.testing.assert_array_equal(shifted_borders(empty, 1.0, 0.5, (0.2, 0.2), rng()), empty)


def test_a_lost_side_narrows_the_mask_from_one_side_in_runs() -> None:
    cut = ErrorSources(wall_loss_share=0.25).masks_with(MASKS, {"wall_loss"}, (0.2, 0.2), rng())
    widths = cut.any(axis=1).sum(axis=1)
    assert set(widths) == {41 - 10}
    lefts = cut.any(axis=1).argmax(axis=1)
    assert set(lefts) == {30, 40}
    assert len(set(lefts[:8])) == 1
    assert (cut <= MASKS).all()


@pytest.mark.parametrize(
    "settings",
    [
        {"mask_bias_mm": float("nan")},
        {"wall_loss_share": 1.0},
        {"wall_loss_share": -0.1},
        {"lag_s": -1.0},
        {"calibration_mm": -1.0},
        {"sound_speed_m_s": 0.0},
    ],
)
def test_a_size_out_of_range_is_refused(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(settings))):
        ErrorSources(**settings)  # type: ignore[arg-type]


def test_an_unknown_source_is_refused() -> None:
    with pytest.raises(InputError, match=r"sources: expected of mask_bias, .*, received wind"):
        ErrorSources().settings_with(PhantomSettings(), {"wind"})
    with pytest.raises(InputError, match="received wind"):
        ErrorSources().masks_with(MASKS, {"wind"}, (0.2, 0.2), rng())
