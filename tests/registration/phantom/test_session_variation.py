"""Sessions: each source of variation alone, repeatable, and every result a valid phantom."""

from __future__ import annotations

import dataclasses

import pytest

from registration.errors import InputError
from registration.phantom.session_variation import SessionVariation
from registration.phantom.settings import PhantomSettings

BASE = PhantomSettings(subset="vein")
NOTHING = {field.name: False for field in dataclasses.fields(SessionVariation) if field.name != "strength"}


def changed(one: PhantomSettings) -> set[str]:
    flat = [dataclasses.asdict(settings) for settings in (BASE, one)]
    return {
        f"{part}.{name}"
        for part in ("scanner", "tissue", "artefacts", "motion", "deformation", "ct")
        for name in flat[0][part]
        if flat[0][part][name] != flat[1][part][name]
    }


def test_nothing_switched_on_changes_the_tissue_alone() -> None:
    session = SessionVariation(**NOTHING)(BASE, 4)
    assert changed(session) == set()
    assert session.subset == "vein"
    assert session.seed != BASE.seed


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("depth", {"scanner.depth_mm"}),
        ("gain", {"scanner.gain_db", "tissue.compensation_db_cm_mhz"}),
        ("speckle", {"scanner.pulse_cycles", "scanner.f_number"}),
        ("contrast", {"tissue.lumen_db", "tissue.wall_echo_db", "tissue.mottle_db", "artefacts.clutter_db"}),
    ],
)
def test_each_source_changes_what_it_says_and_no_more(source: str, expected: set) -> None:
    alone = SessionVariation(**{**NOTHING, source: True})(BASE, 4)
    assert changed(alone) == expected
    # The same draw as when everything varies together.
    together = SessionVariation(shape=False)(BASE, 4)
    for name in expected - {"scanner.looks"}:
        part, key = name.split(".")
        assert getattr(getattr(alone, part), key) == getattr(getattr(together, part), key)


def test_sessions_differ_and_repeat() -> None:
    vary = SessionVariation()
    assert vary(BASE, 2) == vary(BASE, 2)
    assert len({vary(BASE, session).digest() for session in range(20)}) == 20
    assert vary(BASE, 0).subset == "random"
    assert all(vary(BASE, session).anatomy_seed < 1000 for session in range(20))


def test_strongest_variation_still_gives_valid_phantoms() -> None:
    for session in range(100):
        SessionVariation(strength=1.5)(BASE, session)
    with pytest.raises(InputError, match="strength"):
        SessionVariation(strength=2.0)
