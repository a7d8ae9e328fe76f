import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pydicom
import pytest
from dicom_files import region, write_dicom
from drawn_screens import cross_hairs, speckle
from PIL import Image
from pydicom.datadict import tag_for_keyword
from pydicom.uid import MPEG4HP41, JPEGBaseline8Bit, JPEGLSLossless, RLELossless

from experiments.datasets.images.dicom import read_dicom
from experiments.errors import InputError
from models.preprocessing.preprocessing import Preprocessing
from models.preprocessing.sector import sector_of

GREY = speckle((40, 60))
FILM = np.stack([GREY, GREY[::-1], GREY[:, ::-1]])


def test_reads_single_and_multi_frame_files(tmp_path) -> None:
    one = read_dicom(write_dicom(tmp_path / "one.dcm", GREY))
    np.testing.assert_array_equal(one.images, GREY[None])
    assert one.spacing_mm is None and one.region_px is None and one.sector is None
    np.testing.assert_array_equal(read_dicom(write_dicom(tmp_path / "film.dcm", FILM)).images, FILM)


def test_monochrome1_is_inverted(tmp_path) -> None:
    path = write_dicom(tmp_path / "a.dcm", GREY, "MONOCHROME1")
    np.testing.assert_array_equal(read_dicom(path).images[0], 255 - GREY)


@pytest.mark.parametrize("bits", [16, 12, 10])
def test_more_than_eight_bits_are_scaled_by_what_the_bits_allow(tmp_path, bits: int) -> None:
    largest = 2**bits - 1
    deep = np.array([[0, largest // 5, largest]], np.uint16)
    path = write_dicom(tmp_path / "a.dcm", deep, BitsStored=bits, HighBit=bits - 1)
    assert read_dicom(path).images[0].tolist() == [[0, 51, 255]]


def test_colour_is_grey_as_everywhere_without_coloured_marks(tmp_path) -> None:
    rgb = cross_hairs(np.dstack([GREY] * 3), (20, 30), 8, (255, 255, 0))
    images = read_dicom(
        write_dicom(tmp_path / "rgb.dcm", np.stack([rgb, np.dstack([GREY] * 3)]), "RGB")
    ).images
    np.testing.assert_array_equal(images[1], GREY)
    assert images[0].max() <= GREY.max()


def test_ybr_becomes_rgb_before_it_becomes_grey(tmp_path) -> None:
    ybr = np.stack([GREY, np.full_like(GREY, 128), np.full_like(GREY, 128)], axis=-1)
    np.testing.assert_array_equal(
        read_dicom(write_dicom(tmp_path / "a.dcm", ybr, "YBR_FULL")).images[0], GREY
    )


def test_a_palette_gives_its_colours(tmp_path) -> None:
    path = write_dicom(tmp_path / "a.dcm", np.array([[0, 1, 2]], np.uint8), "PALETTE COLOR")
    content = pydicom.dcmread(path)
    table = (np.array([0, 100, 255] + [0] * 253, np.uint16) * 257).tobytes()
    for colour in ("Red", "Green", "Blue"):
        descriptor = tag_for_keyword(f"{colour}PaletteColorLookupTableDescriptor")
        assert descriptor is not None
        content.add_new(descriptor, "US", [256, 0, 16])
        setattr(content, f"{colour}PaletteColorLookupTableData", table)
    content.save_as(path)
    assert read_dicom(path).images[0].tolist() == [[0, 100, 255]]


def test_compressed_frames_are_decoded(tmp_path) -> None:
    path = write_dicom(tmp_path / "rle.dcm", FILM)
    content = pydicom.dcmread(path)
    content.compress(RLELossless)
    content.save_as(path)
    np.testing.assert_array_equal(read_dicom(path).images, FILM)
    stream = io.BytesIO()
    Image.fromarray(GREY).save(stream, "JPEG", quality=95)
    lossy = write_dicom(tmp_path / "jpeg.dcm", GREY, syntax=JPEGBaseline8Bit, encoded=[stream.getvalue()])
    assert np.abs(read_dicom(lossy).images[0].astype(int) - GREY).mean() < 4


def test_spacing_and_region_come_along_and_the_region_is_a_sector(tmp_path) -> None:
    path = write_dicom(tmp_path / "a.dcm", GREY, regions=(region((5, 10, 34, 49), (0.02, 0.01)),))
    frames = read_dicom(path)
    assert frames.spacing_mm == pytest.approx((0.2, 0.1)) and frames.region_px == (5, 10, 35, 50)
    assert frames.sector is not None
    inside = np.zeros(GREY.shape, bool)
    inside[5:35, 10:50] = True
    np.testing.assert_array_equal(sector_of(frames.sector, *GREY.shape), inside)
    clean = Preprocessing(32, sector=frames.sector, crop=True).clean(frames.images)
    np.testing.assert_array_equal(clean[0], np.where(inside, GREY, 0))


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    "content", [b"", b"no DICOM at all", b"\0" * 128 + b"DICM" + b"\x08\0", b"\x89PNG\r\n\x1a\n" * 40]
)
def test_refuses_a_file_of_another_kind(tmp_path, content: bytes) -> None:
    with pytest.raises(InputError, match=r"a\.dcm: expected .*DICOM file"):
        read_dicom(written(tmp_path / "a.dcm", content))
    with pytest.raises(InputError, match=r"none\.dcm: expected a DICOM file, found none"):
        read_dicom(tmp_path / "none.dcm")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("compressed", [False, True])
def test_refuses_a_truncated_film(tmp_path, share: float, compressed: bool) -> None:
    path = write_dicom(tmp_path / "a.dcm", FILM)
    if compressed:
        content = pydicom.dcmread(path)
        content.compress(RLELossless)
        content.save_as(path)
    whole = path.read_bytes()
    with pytest.raises(InputError, match=r"a\.dcm: expected"):
        read_dicom(written(path, whole[: int(share * len(whole)) - 2]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"PixelData": None, "Modality": "SR"}, "with frames, received one of modality SR without pixels"),
        ({"PixelRepresentation": 1}, "expected unsigned pixels, or a window .*, received signed ones"),
        ({"NumberOfFrames": 4}, "expected whole frames that can be decoded"),
        ({"Rows": None}, "expected whole frames that can be decoded"),
        ({"Rows": 0}, "expected whole frames that can be decoded"),
    ],
)
def test_refuses_content_that_is_no_picture(tmp_path, changes: dict[str, Any], message: str) -> None:
    path = write_dicom(tmp_path / "a.dcm", FILM, **changes)
    with pytest.raises(InputError, match=rf"a\.dcm: .*{message}"):
        read_dicom(path)


def test_names_what_to_install_for_a_compression_that_nothing_here_reads(tmp_path, monkeypatch) -> None:
    path = write_dicom(tmp_path / "a.dcm", GREY, syntax=JPEGLSLossless, encoded=[b"\xff\xd8\xff\xf7"])
    monkeypatch.setattr("pydicom.pixels.decoders.base.Decoder.is_available", property(lambda self: False))
    with pytest.raises(InputError, match=r"decodes JPEG-LS Lossless.*, found none; pip install pylibjpeg"):
        read_dicom(path)
    film = write_dicom(tmp_path / "film.dcm", GREY, syntax=MPEG4HP41, encoded=[b"\0\0"])
    with pytest.raises(InputError, match=r"received MPEG-4 .*; convert the file to another transfer syntax"):
        read_dicom(film)


def test_says_how_to_get_pydicom(tmp_path, monkeypatch) -> None:
    path = write_dicom(tmp_path / "a.dcm", GREY)
    monkeypatch.setitem(sys.modules, "pydicom", None)
    with pytest.raises(InputError, match=r"a\.dcm: expected the package pydicom .*; pip install pydicom"):
        read_dicom(path)
