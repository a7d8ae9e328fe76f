"""Known gains of vessels and of aggregation, beside the published values."""

from __future__ import annotations

import pytest
from vessel_type_results import results

from experiments.reporting.measured import SIMULATED
from experiments.studies.vessel_type.measured import measured


def test_aggregated_vessels_and_the_gain_of_aggregation_are_measured() -> None:
    found = {(one.name, one.of): one for one in measured(results())}
    artery, vein = (
        found[f"dsc_{name}", f"unet, {name}, districts aggregated"] for name in ("artery", "vein")
    )
    assert artery.value - vein.value == pytest.approx(0.35)
    assert (artery.n, artery.units, artery.not_comparable, artery.small) == (10, "groups", "", False)
    gains = [one for (name, _), one in found.items() if name == "aggregation_artery"]
    assert gains and all(abs(one.value) == pytest.approx(0.05) for one in gains)
    assert all("signed-rank test, Holm: p" in one.said for one in gains)


def test_simulated_vessels_are_not_comparable() -> None:
    assert {one.not_comparable for one in measured(results(simulated=True))} == {SIMULATED}
