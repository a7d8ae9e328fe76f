"""Results of PLUS's calibrations, read as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.errors import InputError
from registration.readers.plus.results import read_line_rows_px, read_wire_calibration

NAME = "FreehandCalibration3NWires_fCal2.0.results.xml"


def test_wire_calibration_of_plus(real_data: Path) -> None:
    found = read_wire_calibration(real_data / "plus" / NAME)
    assert (len(found.calibration.points_px), found.calibration.failed) == (184, 6)
    assert (len(found.validation.points_px), found.validation.failed) == (103, 0)
    np.testing.assert_allclose(found.probe_A_pixel[:3, 3], [11.2137, 48.4162, -0.398993])
    assert (found.calibration_error_mm, found.validation_error_mm) == (0.479116, 0.539932)
    assert (found.width_px, found.height_px) == (820, 616)
    assert found.calibration.points_px[0, 0].tolist() == [592.1, 195.808]
    assert found.calibration.middle_probe_mm is not None
    assert found.calibration.middle_probe_mm[0, 0].tolist() == [24.8858, 7.84206, 0.7266]
    assert found.validation.middle_probe_mm is None


def test_result_with_nothing_segmented_is_refused(real_data: Path, tmp_path: Path) -> None:
    text = (
        (real_data / "plus" / NAME)
        .read_text()
        .replace('SegmentationStatus="OK"', 'SegmentationStatus="Failed"')
    )
    path = tmp_path / "failed.results.xml"
    path.write_text(text)
    with pytest.raises(
        InputError, match=r"failed\.results\.xml: expected frames with segmented wires, found none"
    ):
        read_wire_calibration(path)


def test_invalid_pose_is_refused(real_data: Path, tmp_path: Path) -> None:
    old = 'Name="ProbeToTrackerTransformStatus" Value="OK"'
    text = (real_data / "plus" / NAME).read_text()
    path = tmp_path / "lost.results.xml"
    path.write_text(text.replace(old, old.replace("OK", "INVALID"), 1))
    with pytest.raises(
        InputError, match=r"lost\.results\.xml: frame 0: transform ReferenceToProbe: expected a chain"
    ):
        read_wire_calibration(path)


def test_other_xml_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.xml"
    path.write_text("<PlusConfiguration/>")
    with pytest.raises(InputError, match=r"other\.xml: expected a ProbeCalibrationResult"):
        read_wire_calibration(path)
    with pytest.raises(InputError, match=r"other\.xml: expected frames with line positions"):
        read_line_rows_px(path, 10.0)


def test_line_rows(tmp_path: Path) -> None:
    path = tmp_path / "lines.xml"
    path.write_text(
        '<LineSegmentationResults><Frame Index="0" SegmentationStatus="OK" LineOriginPointPx="100 50" '
        'LineDirectionVectorPx="0.8 -0.6"/><Frame Index="1" SegmentationStatus="Failed"/></LineSegmentationResults>'
    )
    np.testing.assert_allclose(read_line_rows_px(path, 140.0), [20.0, np.nan])
