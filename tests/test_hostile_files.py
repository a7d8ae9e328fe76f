"""Files made to hurt: devices, pipes, paths that lead away, bombs, aliases, counts of two thousand millions."""

from __future__ import annotations

import os
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from damage import REFUSALS, REFUSED, said
from stored_pngs import chunk

from experiments.cli import main
from experiments.datasets.csv_tables import read_table
from experiments.datasets.images.decoding import decode
from experiments.splits.split import Split
from models.settings_file import read_settings
from registration.io.landmarks import read_landmarks
from registration.io.surfaces import read_centerline, read_surface
from registration.io.transforms import read_transform
from registration.io.volumes import read_volume
from registration.readers.plus.calibration_file import read_calibration
from registration.readers.plus.config import read_device_set
from registration.readers.plus.fields import read_sequence
from registration.readers.rosbag.reader import RosbagReader
from registration.readers.streams.image_files import decode_image

MIB = 1 << 20
META = "NDims = 3\nDimSize = {}\nElementType = MET_UCHAR\n{}UltrasoundImageOrientation = MF\nElementDataFile = {}\n"
NRRD = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: {}\nencoding: {}\nkinds: domain domain list\n{}\n"
VTP = (
    '<VTKFile type="PolyData" byte_order="LittleEndian"><PolyData><Piece NumberOfPoints="{}" NumberOfLines="{}">'
    '<Points><DataArray type="Float32" NumberOfComponents="3">0 0 0 1 1 1</DataArray></Points><Lines>'
    '<DataArray type="Int64" Name="connectivity">0 {}</DataArray><DataArray type="Int64" Name="offsets">2</DataArray>'
    "</Lines></Piece></PolyData></VTKFile>"
)
VTK = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\n"
VTK += "POINTS {} {}\n0 0 0 1 0 0 0 1 0\nPOLYGONS {} {}\n{} 0 1 2\n"
PLY = (
    "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n"
    "property list uchar int vertex_indices\nend_header\n"
)
CORNERS = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
ALIASES = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + n)}: &{chr(98 + n)} [{', '.join(['*' + chr(97 + n)] * 10)}]\n" for n in range(9)
)


def png(path: Path) -> np.ndarray:
    return decode_image(path, str(path))


def table(path: Path) -> Any:
    return read_table(path, ("case",))


def refuse(read: Callable[[Path], Any], path: Path) -> str:
    """What the reader says; at once, and by the name of the file."""
    # Time of this process: what else runs on the machine does not count.
    began = time.process_time()
    how, message = said(read, path)
    assert how == REFUSED, (how, message)
    assert time.process_time() - began < 5
    assert len(message) < 800
    return message


READERS = [
    (read_volume, "a.mha"), (read_volume, "a.nrrd"), (read_volume, "a.nii"), (read_volume, "a.nii.gz"),
    (read_sequence, "a.igs.mha"), (read_sequence, "a.igs.nrrd"), (read_surface, "a.ply"), (read_surface, "a.vtk"),
    (read_centerline, "a.vtp"), (read_landmarks, "a.mrk.json"), (read_transform, "a.json"), (read_transform, "a.h5"),
    (read_calibration, "a.yaml"), (read_device_set, "a.xml"), (png, "a.png"), (decode, "a.png"), (table, "a.csv"),
    (Split.read, "a.json"), (read_settings, "a.yaml"),
]  # fmt: skip


@pytest.mark.parametrize(("read", "name"), READERS, ids=lambda each: getattr(each, "__qualname__", each))
def test_pipes_devices_and_folders_are_never_opened(
    read: Callable[[Path], Any], name: str, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / name)
    refuse(read, tmp_path / name)
    (tmp_path / name).unlink()
    (tmp_path / name).symlink_to("/dev/zero")
    refuse(read, tmp_path / name)
    (tmp_path / name).unlink()
    (tmp_path / name).mkdir()
    refuse(read, tmp_path / name)


@pytest.mark.parametrize(
    "place", ["/dev/zero", "/etc/passwd", "../secret.raw", "inner/../../secret.raw", "C:\\x.raw"]
)
@pytest.mark.parametrize("read", [read_volume, read_sequence])
def test_headers_name_files_in_their_own_folder_alone(
    read: Callable[[Path], Any], place: str, tmp_path: Path
) -> None:
    folder = tmp_path / "scan"
    folder.mkdir()
    (tmp_path / "secret.raw").write_bytes(b"\1" * 64)
    for name, text in (
        ("a.igs.mhd", META.format("4 4 4", "", place)),
        ("b.igs.mhd", META.format("4 4 4", "", f"LIST\n{place}")),
        ("a.igs.nhdr", NRRD.format("4 4 4", "raw", f"data file: {place}\n")),
    ):
        (folder / name).write_text(text)
        assert "own folder" in refuse(read, folder / name)


def test_a_pipe_among_the_data_files_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "v.raw")
    (tmp_path / "a.mhd").write_text(META.format("4 4 4", "", "v.raw"))
    assert "a pipe" in refuse(read_volume, tmp_path / "a.mhd")


def test_metadata_of_a_bag_name_files_in_its_folder_alone(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  relative_file_paths: [../../../etc/passwd]\n"
    )
    (tmp_path / "calibration.yaml").write_text("probe_A_pixel: [[1,0,0,0],[0,1,0,0],[0,0,1,0]]\n")
    assert "own folder" in refuse(RosbagReader("/a", "/b"), tmp_path)


def test_small_files_that_unpack_to_gigabytes_are_refused(tmp_path: Path) -> None:
    packer, zeros = zlib.compressobj(9, zlib.DEFLATED, 31), bytes(16 * MIB)
    # 64 MB are enough: how large it gets is for the header to say, and for the first byte too many.
    packed = b"".join(packer.compress(zeros) for _ in range(4)) + packer.flush()
    honest, small = "1024 1024 4096", "4 4 4"
    for number, (sizes, message) in enumerate(((honest, "promises 4294967296 bytes"), (small, "found more"))):
        (tmp_path / f"{number}.igs.mha").write_bytes(
            META.format(sizes, "CompressedData = True\n", "LOCAL").encode() + zlib.compress(zeros)
        )
        (tmp_path / f"{number}.igs.nrrd").write_bytes(NRRD.format(sizes, "gzip", "").encode() + packed)
        for read in (read_volume, read_sequence):
            assert message in refuse(read, tmp_path / f"{number}.igs.mha")
            assert message in refuse(read, tmp_path / f"{number}.igs.nrrd")
    header = struct.pack(">IIBBBBB", 64, 64, 8, 0, 0, 0, 0)
    pixels = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(zeros)) + chunk(b"IEND", b"")
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + pixels)
    for read_image in (png, decode):
        refuse(read_image, tmp_path / "a.png")


@pytest.mark.parametrize("packing", ["CompressedData = True\n", ""])
@pytest.mark.parametrize("sizes", ["2000000000 1 1", "2000000000 2000000000 2000000000"])
def test_sizes_of_two_thousand_millions_take_no_memory(sizes: str, packing: str, tmp_path: Path) -> None:
    (tmp_path / "a.igs.mha").write_bytes(
        META.format(sizes, packing, "LOCAL").encode() + zlib.compress(b"0" * 9)
    )
    for read in (read_volume, read_sequence):
        refuse(read, tmp_path / "a.igs.mha")


SURFACES: dict[str, str | bytes] = {
    "index.ply": PLY.format("ascii", 4, 1) + CORNERS + "3 0 1 9\n",
    "corners.ply": PLY.format("ascii", 4, 2) + CORNERS + "0\n3 0 1 9\n",
    "many.ply": PLY.format("binary_little_endian", 2_000_000_000, 1).encode() + bytes(64),
    "faces.ply": PLY.format("binary_little_endian", 4, 2_000_000_000).encode() + bytes(64),
    "many.stl": bytes(80) + struct.pack("<I", 2_000_000_000) + bytes(100),
    "many.pcd": "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2000000000\nHEIGHT 1\nDATA binary\n",
    "wide.pcd": "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 900000000\nWIDTH 1\nDATA ascii\n0 0 0\n",
    "many.vtk": VTK.format(2_000_000_000, "float", 1, 4, 3),
    "type.vtk": VTK.format(2_000_000_000, "strange", 1, 4, 3),
    "cells.vtk": VTK.format(3, "float", 2_000_000_000, 4, 3),
    "long.vtk": VTK.format(3, "float", 1, 4, 99_999_999),
    "negative.vtk": VTK.format(3, "float", 1, 4, -5),
    "texts.vtk": VTK.format(3, "float", 1, 4, 3) + "FIELD f 1\nq 2000000000 1 string\n",
    "values.vtk": VTK.format(3, "float", 1, 4, 3) + "POINT_DATA 2000000000\nSCALARS a float 1\nLOOKUP_TABLE default\n",
    "many.vtp": VTP.format(2_000_000_000, 1, 1),
    "cells.vtp": VTP.format(2, 2_000_000_000, 1),
    "index.vtp": VTP.format(2, 1, 77_777),
}  # fmt: skip


@pytest.mark.parametrize("name", SURFACES)
def test_counts_and_indices_are_checked_before_a_library_follows_them(name: str, tmp_path: Path) -> None:
    content = SURFACES[name]
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    refuse(read_surface, tmp_path / name)
    if name.endswith(".vtp"):
        refuse(read_centerline, tmp_path / name)


@pytest.mark.parametrize(
    "text",
    [ALIASES + "probe_A_pixel: *j\n", "probe_A_pixel: &a [*a]\n", "probe_A_pixel: " + "[" * 3_000, "a: b\n" * 300_000],
    ids=["aliases of aliases", "an alias of itself", "deep", "long"],
)  # fmt: skip
@pytest.mark.parametrize("read", [read_calibration, read_settings])
def test_yaml_stays_small(read: Callable[[Path], Any], text: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(text)
    refuse(read, tmp_path / "a.yaml")


def test_deep_json_and_xml_are_refused(tmp_path: Path) -> None:
    deep = "[" * 100_000 + "]" * 100_000
    for name, text, read in (
        ("a.json", f'{{"fixed_T_moving": {deep}}}', read_transform),
        ("a.mrk.json", f'{{"markups": {deep}}}', read_landmarks),
        ("b.json", deep, Split.read),
        ("a.xml", "<a>" * 100_000, read_device_set),
    ):
        (tmp_path / name).write_text(text)
        refuse(read, tmp_path / name)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_of_xml_are_refused_in_any_encoding(encoding: str, tmp_path: Path) -> None:
    text = '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><PlusConfiguration>&b;</PlusConfiguration>'
    (tmp_path / "a.xml").write_bytes(text.encode(encoding))
    assert "document type" in refuse(read_device_set, tmp_path / "a.xml")


def test_a_nifti_header_that_says_less_of_a_voxel_than_its_type_takes(tmp_path: Path) -> None:
    import SimpleITK

    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(np.zeros((4, 4, 4), np.uint8)), str(tmp_path / "a.nii"))
    data = bytearray((tmp_path / "a.nii").read_bytes())
    struct.pack_into("<8h", data, 40, 3, 30_000, 30_000, 2, 1, 1, 1, 1)
    struct.pack_into("<h", data, 72, 0)
    (tmp_path / "a.nii").write_bytes(data)
    assert "known type of voxels" in refuse(read_volume, tmp_path / "a.nii")


@pytest.mark.parametrize("axes", ["-1", "0", "2", "4", "2000000000", "three"])
def test_a_number_of_axes_that_is_not_that_of_the_sizes_reaches_no_library(axes: str, tmp_path: Path) -> None:
    meta = META.format("4 4 4", "", "LOCAL").replace("NDims = 3", f"NDims = {axes}").encode() + bytes(64)
    nrrd = NRRD.format("4 4 4", "raw", "").replace("dimension: 3", f"dimension: {axes}").encode() + bytes(64)
    (tmp_path / "a.mha").write_bytes(meta)
    (tmp_path / "a.nrrd").write_bytes(nrrd)
    assert "as many axes as sizes" in refuse(read_volume, tmp_path / "a.mha")
    assert "as many axes as sizes" in refuse(read_volume, tmp_path / "a.nrrd")


@pytest.mark.parametrize("kind", REFUSALS, ids=lambda kind: kind.__module__)
def test_a_refusal_is_one_line_that_commands_no_terminal(kind: type[Exception]) -> None:
    said = str(kind("a.dcm: expected a syntax, received 1.2\n\x1b[2J\x9b1m\x7f größer"))
    assert said == "a.dcm: expected a syntax, received 1.2\\n\\x1b[2J\\x9b1m\\x7f größer"


def test_a_name_that_commands_the_terminal_is_printed_as_text(home: Path, capsys) -> None:
    assert main(["study=register", "moving=\x1b]0;owned\x07.ply", "fixed=b.ply"]) == 2
    said = capsys.readouterr()
    assert "owned" in said.err
    assert "\x1b" not in said.err + said.out and "\x07" not in said.err + said.out
