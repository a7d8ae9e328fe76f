"""The study meets PLUS's values and leaves a calibration that readers take."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.outcome import Outcome, Silent
from experiments.studies import calibrate_spatial
from registration.calibration.spatial import NWireCalibration
from registration.readers.plus.calibration_file import read_calibration
from registration.readers.plus.config import read_device_set

RESULTS = "FreehandCalibration3NWires_fCal2.0.results.xml"
PHANTOM = "PlusDeviceSet_fCal_Sim_SpatialCalibration_2.0.xml"


def calibrated(results: Path, phantom: Path, workspace: Path) -> Outcome:
    return calibrate_spatial.run(
        results=str(results),
        device_set=str(phantom),
        probe="Probe",
        reference="Reference",
        phantom_frame="Phantom",
        best_share=0.95,
        spatial=NWireCalibration(),
        workspace=workspace,
        progress=Silent(),
    )


def test_values_of_plus_and_files_left(real_data: Path, tmp_path: Path) -> None:
    outcome = calibrated(real_data / "plus" / RESULTS, real_data / "plus" / PHANTOM, tmp_path)
    assert outcome.metrics["error_calibration_mm"] == pytest.approx(0.479, abs=5e-4)
    assert outcome.metrics["error_validation_mm"] == pytest.approx(0.540, abs=5e-4)
    assert outcome.metrics["corner_displacement_max_mm"] < 0.1
    yaml, xml = read_calibration(tmp_path / "probe.yaml"), read_calibration(tmp_path / "probe.xml")
    np.testing.assert_array_equal(yaml.probe_A_pixel, xml.probe_A_pixel)
    np.testing.assert_allclose(yaml.probe_A_pixel[:3, 3], [11.2137, 48.4162, -0.398993], atol=2e-3)
    assert outcome.cases is not None
    assert len(outcome.cases) == 3 * (184 + 103)
    assert outcome.cases["outlier"].sum() == outcome.metrics["outliers"]


def test_registration_missing_from_the_device_set_comes_from_the_results(
    real_data: Path, tmp_path: Path
) -> None:
    text = (real_data / "plus" / PHANTOM).read_text()
    phantom = tmp_path / "phantom.xml"
    phantom.write_text(re.sub(r'<Transform From="Phantom".*?/>', "", text, flags=re.DOTALL))
    assert ("Phantom", "Reference") not in read_device_set(phantom).transforms.edges
    outcome = calibrated(real_data / "plus" / RESULTS, phantom, tmp_path)
    assert outcome.metrics["error_calibration_mm"] == pytest.approx(0.479, abs=5e-4)
    assert "registered to the middle points" in outcome.findings[0]


def test_device_set_without_wires_is_refused(real_data: Path, tmp_path: Path) -> None:
    phantom = tmp_path / "phantom.xml"
    phantom.write_text("<PlusConfiguration/>")
    with pytest.raises(
        InputError, match=r"device_set: expected NWire patterns in .*phantom\.xml, found none"
    ):
        calibrated(real_data / "plus" / RESULTS, phantom, tmp_path)


def test_missing_files_are_refused() -> None:
    with pytest.raises(InputError, match="results: expected a file or folder"):
        calibrate_spatial.check(results="absent", device_set="absent")
