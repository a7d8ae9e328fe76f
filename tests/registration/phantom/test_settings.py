"""Settings refuse what they cannot be, by name."""

from __future__ import annotations

import pytest
from registration.errors import InputError
from registration.phantom.settings import CtScan, Motion, PhantomSettings, Scanner, Tissue


@pytest.mark.parametrize(
    ("kind", "setting"),
    [
        (Scanner, {"height_px": 4}),
        (Scanner, {"depth_mm": 0.0}),
        (Scanner, {"dynamic_range_db": -1.0}),
        (Tissue, {"scatterers_per_mm3": 0.0}),
        (Tissue, {"fascia_count": -1}),
        (Motion, {"frames": 1}),
        (Motion, {"duration_s": 0.0}),
        (Motion, {"noise_mm": -0.1}),
        (Motion, {"pose_rate_hz": 0.0}),
        (CtScan, {"voxel_mm": 0.0}),
        (CtScan, {"blur_mm": -1.0}),
        (PhantomSettings, {"subset": "liver"}),
        (PhantomSettings, {"seed": -1}),
    ],
)
def test_bad_settings_are_named(kind: type, setting: dict) -> None:
    with pytest.raises(InputError, match=f"^{next(iter(setting))}: expected .*, received "):
        kind(**setting)


def test_wavelength_and_pixel_size() -> None:
    assert Scanner(frequency_mhz=7.7).wavelength_mm == pytest.approx(0.2)
    assert Scanner(depth_mm=50, height_px=250).pixel_mm == pytest.approx(0.2)
