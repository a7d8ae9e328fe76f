"""The sweeps that all networks segment: which they are, and that their pictures are those of the simulator."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.studies.propagation.sweeps import Sweeps
from registration.phantom.acoustics import Scanner
from registration.phantom.conditions import Motion
from registration.phantom.scan import simulate_sweep
from registration.phantom.session_variation import SessionVariation
from registration.phantom.settings import PhantomSettings

TINY = PhantomSettings(
    subset="random", scanner=Scanner(height_px=48, width_px=48), motion=Motion(frames=3, length_mm=90.0)
)


def sweeps(**changes: Any) -> Sweeps:
    settings: dict[str, Any] = {
        "phantom": TINY, "phantoms": ["random"], "first_sweep": 1000, "sweeps": 2,
        "sessions": SessionVariation(shape=False), "cache": ".cache/phantom",
    }  # fmt: skip
    return Sweeps(**(settings | changes))


def test_each_random_sweep_is_of_another_vessel_and_session() -> None:
    first, second = sweeps().planned()
    assert [one.vessel for one in (first, second)] == ["random 1000", "random 1001"]
    assert [one.settings.anatomy_seed for one in (first, second)] == [1000, 1001]
    assert first.settings.scanner != second.settings.scanner
    plain, other = sweeps(sessions=None).planned()
    assert plain.settings.scanner == other.settings.scanner == TINY.scanner


def test_sweeps_of_another_phantom_are_all_of_one_vessel() -> None:
    planned = sweeps(phantoms=["artery", "vein"]).planned()
    assert [(one.phantom, one.vessel, one.number) for one in planned] == [
        (name, name, number) for name in ("artery", "vein") for number in (1000, 1001)
    ]


def test_pictures_and_masks_are_those_of_the_simulator(tmp_path: Path) -> None:
    plan = sweeps(sweeps=1, cache=str(tmp_path))
    (one,) = plan.planned()
    plan.prepare(workers=1)
    whole = simulate_sweep(one.settings, one.number)
    for _ in range(2):
        found = plan.simulated(one, pictures=True)
        assert np.array_equal(found.sweep.images, whole.sweep.images)
        assert np.array_equal(found.masks, whole.masks)
        assert np.array_equal(found.ct_T_world, whole.ct_T_world)
    assert not plan.simulated(one, pictures=False).sweep.images.any()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"phantoms": []}, "phantoms: expected a list of phantoms"),
        ({"phantoms": "artery"}, "phantoms: expected a list of phantoms"),
        ({"phantoms": ["artery", "artery"]}, "phantoms: expected each once"),
        ({"sweeps": 0}, "sweeps: expected"),
        ({"first_sweep": 999}, "first_sweep: expected 1000 or more"),
        ({"phantom": replace(TINY, mesh="vessel.stl")}, "phantoms: expected"),
    ],
)
def test_sweeps_that_cannot_be_made_or_were_trained_on_are_refused(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        sweeps(**changes)
