"""A probe's calibration from YAML and from PLUS's XML."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sweeps import CALIBRATION

from registration.errors import InputError
from registration.readers.plus.calibration_file import calibration_yaml, read_calibration, read_yaml
from registration.sweep import ProbeCalibration


def test_yaml_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    tiny = ProbeCalibration(CALIBRATION.ee_T_probe, CALIBRATION.probe_A_pixel + 1e-17 * np.eye(4, k=2))
    path = tmp_path / "probe.yaml"
    path.write_text(calibration_yaml(tiny))
    found = read_calibration(path)
    np.testing.assert_array_equal(found.probe_A_pixel, tiny.probe_A_pixel)
    np.testing.assert_array_equal(found.ee_T_probe, tiny.ee_T_probe)


def test_result_of_plus_is_read_as_it_is(real_data: Path) -> None:
    found = read_calibration(real_data / "plus" / "FreehandCalibration3NWires_fCal2.0.results.xml")
    np.testing.assert_allclose(found.probe_A_pixel[:3, 3], [11.2137, 48.4162, -0.398993])
    np.testing.assert_array_equal(found.ee_T_probe, np.eye(4))


def test_a_third_column_of_zeros_is_completed(tmp_path: Path) -> None:
    """Right-handed, normal to the image, as long as the mean step of a pixel; pixels stay where they were."""
    path = tmp_path / "probe.yaml"
    path.write_bytes("probe_A_pixel: [[0, -0.2, 0, 1], [0.1, 0, 0, 2], [0, 0, 0, 3]]\n".encode("utf-8-sig"))
    found = read_calibration(path).probe_A_pixel
    np.testing.assert_allclose(
        found, [[0, -0.2, 0, 1], [0.1, 0, 0, 2], [0, 0, 0.15, 3], [0, 0, 0, 1]], atol=1e-12
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "probe_A_pixel: [[0.1,0.1,0,0],[0.2,0.2,0,0],[0,0,0,0]]\n",
            "two independent directions, received parallel",
        ),
        (
            "probe_A_pixel: [0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 0.1, 0]\n",
            r"found shape \(12,\)",
        ),
        (
            "probe_A_pixel: [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 1]]\n",
            r"four rows of four numbers, found shape \(3, 3\)",
        ),
        ("probe_A_pixel: [[0.1,0,0,0],[0,0.1,0,0],[0,0,.nan,0]]\n", "expected probe_A_pixel as four rows"),
        ("probe_A_pixel: [[0.1,0,0,0],[0,0.1,0,0],[0,0,0,0],[1,2,3,1]]\n", "expected last row 0 0 0 1"),
        ("probe_A_pixel: null\n", "expected probe_A_pixel as four rows"),
        ("ee_T_probe: []\n", "expected the key probe_A_pixel, found ee_T_probe"),
        ("probe_A_pixel: [[1, 2], [3]]\n", "expected probe_A_pixel as four rows of four numbers"),
        ("probe_A_pixel: [[1, 2], [3, 4]]\n", r"expected probe_A_pixel as four rows .* found shape \(2, 2\)"),
        ("- 1\n", "expected a mapping of keys to values, found list"),
        (
            "probe_A_pixel: [[1,0,0,0],[2,0,0,0],[0,0,1,0]]\n",
            r"expected probe_A_pixel in millimetres|expected an inv",
        ),
    ],
)
def test_broken_yaml_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "probe.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"probe\.yaml: .*({message})"):
        read_calibration(path)


def test_xml_without_the_chain_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "set.xml"
    path.write_text("<PlusConfiguration/>")
    with pytest.raises(InputError, match=r"set\.xml: transform ImageToProbe: expected a chain"):
        read_calibration(path)


def test_a_key_given_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sweep.yaml"
    path.write_text("units: mm\nunits: m\n")
    with pytest.raises(InputError, match=r"sweep\.yaml: expected each key once, found units twice"):
        read_yaml(path)
