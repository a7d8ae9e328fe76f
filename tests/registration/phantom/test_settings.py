"""Settings refuse what they cannot be, by name; the defaults are frozen."""

from __future__ import annotations

import pytest

from registration.errors import InputError
from registration.phantom.acoustics import Artefacts, Scanner, Tissue
from registration.phantom.conditions import CtScan, Deformation, Motion
from registration.phantom.settings import PhantomSettings

# The difficulty of the simulator is set once. Changing a default changes every simulated result: this digest is to be
# changed only together with a new baseline of all of them.
FROZEN = "42673a5bb238d7b8e360d3353698f9a6fb6cabf5b137e3471b3acd9d6699747d"


def test_defaults_are_frozen() -> None:
    assert PhantomSettings().digest() == FROZEN


@pytest.mark.parametrize(
    ("kind", "setting"),
    [
        (Scanner, {"geometry": "round"}),
        (Scanner, {"height_px": 4}),
        (Scanner, {"depth_mm": 0.0}),
        (Scanner, {"dynamic_range_db": -1.0}),
        (Scanner, {"looks": 0}),
        (Scanner, {"aperture_mm": 200.0, "geometry": "convex"}),
        (Tissue, {"scatterers_per_mm3": 0.0}),
        (Tissue, {"fascia_count": -1}),
        (Tissue, {"sound_speed_m_s": 0.0}),
        (Artefacts, {"shadows": -1}),
        (Artefacts, {"contact_loss_mm": -1.0}),
        (Artefacts, {"edge_shadow": 0.5}),
        (Motion, {"frames": 1}),
        (Motion, {"duration_s": 0.0}),
        (Motion, {"noise_mm": -0.1}),
        (Motion, {"pose_rate_hz": 0.0}),
        (Deformation, {"bend_mm": 20.0}),
        (Deformation, {"pressure_mm": 15.0}),
        (Deformation, {"squeeze": 0.9}),
        (CtScan, {"voxel_mm": 0.0}),
        (CtScan, {"blur_mm": -1.0}),
        (PhantomSettings, {"subset": "liver"}),
        (PhantomSettings, {"seed": -1}),
        (PhantomSettings, {"anatomy_seed": -1}),
    ],
)
def test_bad_settings_are_named(kind: type, setting: dict) -> None:
    with pytest.raises(InputError, match=f"^{next(iter(setting))}: expected .*, received "):
        kind(**setting)


def test_a_mesh_needs_its_file_and_takes_the_place_of_the_subset() -> None:
    with pytest.raises(InputError, match=r"^mesh: expected the file of a closed surface"):
        PhantomSettings(subset="mesh")
    assert PhantomSettings(subset="vein", mesh="some.stl").subset == "mesh"


def test_wavelength_and_pixel_size() -> None:
    assert Scanner(frequency_mhz=7.7).wavelength_mm == pytest.approx(0.2)
    assert Scanner(depth_mm=50, height_px=250).pixel_mm == pytest.approx(0.2)


def test_phantoms_of_one_seed_do_not_share_their_tissue() -> None:
    entropies = {PhantomSettings(subset=subset).entropy for subset in ("vein", "artery", "artificial")}
    assert len(entropies | {PhantomSettings(subset="random", anatomy_seed=3).entropy}) == 4
