"""Grey values of DICOM files as a viewer shows them, against the formulas worked out by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dicom_files import write_dicom
from pydicom.dataset import Dataset
from pydicom.sequence import Sequence

from experiments.datasets.images.dicom import read_dicom
from experiments.errors import InputError

SMALL = np.array([[0, 64, 128, 255]], dtype=np.uint16)


def item(**attributes: Any) -> Dataset:
    made = Dataset()
    for name, value in attributes.items():
        setattr(made, name, value)
    return made


def of_all(**groups: Dataset) -> Sequence:
    """Functional groups with one item of each kind."""
    made = Dataset()
    for kind, content in groups.items():
        setattr(made, kind, Sequence([content]))
    return Sequence([made])


def shown(path: Path, pixels: np.ndarray, photometric: str = "MONOCHROME2", **changes: Any) -> list[int]:
    return [
        int(value) for value in read_dicom(write_dicom(path, pixels, photometric, **changes)).images[0, 0]
    ]


@pytest.mark.parametrize("bits", [16, 12])
def test_values_of_8_bits_in_16_are_shown_through_their_window(tmp_path: Path, bits: int) -> None:
    more = {"WindowCenter": "128", "WindowWidth": "256", "BitsStored": bits, "HighBit": bits - 1}
    assert shown(tmp_path / "a.dcm", SMALL, **more) == [0, 64, 128, 255]
    assert shown(tmp_path / "b.dcm", SMALL, "MONOCHROME1", **more) == [255, 191, 127, 0]
    # The first of several windows counts.
    several = {**more, "WindowCenter": ["128", "10"], "WindowWidth": ["256", "20"]}
    assert shown(tmp_path / "c.dcm", SMALL, **several) == [0, 64, 128, 255]


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        # (x - 99.5) / 100 + 0.5 of width 101; (x - 100) / 100 + 0.5 and 1 / (1 + exp(-4 (x - 100) / 100)) of width 100.
        ("LINEAR", [0, 1, 129, 255]),
        ("LINEAR_EXACT", [0, 0, 128, 255]),
        ("SIGMOID", [5, 30, 128, 250]),
    ],
)
def test_a_windows_function_is_applied(tmp_path: Path, function: str, expected: list[int]) -> None:
    pixels = np.array([[0, 50, 100, 200]], dtype=np.uint8)
    more = {"WindowCenter": "100", "WindowWidth": "101", "VOILUTFunction": function}
    if function != "LINEAR":
        more["WindowWidth"] = "100"
    assert shown(tmp_path / "a.dcm", pixels, **more) == expected


def test_values_are_rescaled_before_the_window(tmp_path: Path) -> None:
    more = {"RescaleSlope": "2", "RescaleIntercept": "-100", "WindowCenter": "0.5", "WindowWidth": "201"}
    # 2 x - 100 of 0, 50, 100 is -100, 0, 100: the ends and the middle of the window.
    assert shown(tmp_path / "a.dcm", np.array([[0, 50, 100]], np.uint8), **more) == [0, 128, 255]


def test_a_rescaling_that_turns_the_scale_round_is_seen_without_a_window(tmp_path: Path) -> None:
    pixels = np.array([[0, 100, 255]], np.uint8)
    assert shown(tmp_path / "a.dcm", pixels, RescaleSlope="-1", RescaleIntercept="255") == [255, 155, 0]
    assert shown(tmp_path / "b.dcm", pixels, RescaleSlope="3", RescaleIntercept="7") == [0, 100, 255]


@pytest.mark.parametrize("where", ["shared", "each"])
def test_an_enhanced_file_has_window_and_spacing_in_its_functional_groups(tmp_path: Path, where: str) -> None:
    film = np.stack([SMALL, SMALL[:, ::-1]])
    groups = of_all(
        FrameVOILUTSequence=item(WindowCenter="128", WindowWidth="256"),
        PixelValueTransformationSequence=item(RescaleSlope="1", RescaleIntercept="0"),
        PixelMeasuresSequence=item(PixelSpacing=["0.2", "0.1"]),
    )
    more: dict[str, Any] = (
        {"SharedFunctionalGroupsSequence": groups}
        if where == "shared"
        else {"PerFrameFunctionalGroupsSequence": Sequence([groups[0], groups[0]])}
    )
    frames = read_dicom(write_dicom(tmp_path / "a.dcm", film, **more))
    assert frames.images[:, 0].tolist() == [[0, 64, 128, 255], [255, 128, 64, 0]]
    assert frames.spacing_mm == (0.2, 0.1)


def test_each_frame_has_its_own_window_and_all_one_pixel_size(tmp_path: Path) -> None:
    film = np.stack([SMALL, SMALL])
    frames = [
        of_all(
            FrameVOILUTSequence=item(WindowCenter=centre, WindowWidth="256"),
            PixelMeasuresSequence=item(PixelSpacing=spacing),
        )[0]
        for centre, spacing in (("128", ["0.2", "0.1"]), ("192", ["0.3", "0.1"]))
    ]
    path = write_dicom(tmp_path / "a.dcm", film, PerFrameFunctionalGroupsSequence=Sequence(frames))
    with pytest.raises(InputError, match=r"a\.dcm: expected one pixel size for all frames, received 2"):
        read_dicom(path)
    frames[1].PixelMeasuresSequence[0].PixelSpacing = ["0.2", "0.1"]
    path = write_dicom(tmp_path / "b.dcm", film, PerFrameFunctionalGroupsSequence=Sequence(frames))
    assert read_dicom(path).images[:, 0].tolist() == [[0, 64, 128, 255], [0, 0, 64, 191]]


@pytest.mark.parametrize("kind", ["VOILUTSequence", "ModalityLUTSequence"])
def test_tables_give_their_entries(tmp_path: Path, kind: str) -> None:
    """Four entries of 8 bits from value 10 on: what lies outside is given the first or the last."""
    pixels = np.array([[0, 10, 11, 12, 13, 900]], np.uint16)
    entries = np.array([0, 50, 100, 255])
    for bits, data in (
        (8, entries.astype("<u2")),
        (8, entries.astype("u1")),
        (16, (257 * entries).astype("<u2")),
    ):
        table = item(LUTDescriptor=[4, 10, bits], LUTData=data.tobytes())
        assert shown(tmp_path / "a.dcm", pixels, **{kind: Sequence([table])}) == [0, 0, 50, 100, 255, 255]
    table = item(LUTDescriptor=[5, 10, 8], LUTData=entries.astype("u1").tobytes())
    with pytest.raises(InputError, match=r"a\.dcm: .*a table of 4 values where 5 are announced"):
        shown(tmp_path / "a.dcm", pixels, **{kind: Sequence([table])})


@pytest.mark.parametrize(("bits", "largest"), [(16, 255), (16, 4095), (12, 255)])
def test_values_that_use_few_of_the_bits_stored_are_refused_without_a_window(
    tmp_path: Path, bits: int, largest: int
) -> None:
    pixels = np.array([[0, largest // 2, largest]], np.uint16)
    with pytest.raises(
        InputError,
        match=rf"a\.dcm: expected a window \(WindowCenter, WindowWidth\) or values that use the {bits} bits stored, "
        rf"received none and values up to {largest}",
    ):
        shown(tmp_path / "a.dcm", pixels, BitsStored=bits, HighBit=bits - 1)
    assert shown(tmp_path / "black.dcm", pixels * 0) == [0, 0, 0]


def test_signed_values_need_a_window_and_one_of_no_width_is_none(tmp_path: Path) -> None:
    pixels = np.array([[-100, 0, 100]], np.int16)
    window = {"WindowCenter": "0.5", "WindowWidth": "201"}
    assert shown(tmp_path / "a.dcm", pixels, PixelRepresentation=1, **window) == [0, 128, 255]
    with pytest.raises(InputError, match="expected unsigned pixels, or a window"):
        shown(tmp_path / "b.dcm", pixels, PixelRepresentation=1, WindowCenter="0", WindowWidth="0")
    assert shown(tmp_path / "c.dcm", np.array([[0, 9]], np.uint8), WindowCenter="0", WindowWidth="0") == [
        0,
        9,
    ]
