"""Every reader of the project with a file that the project's own writers make, to be changed for tests."""

from __future__ import annotations

import bz2
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

LABELS = np.zeros((6, 10, 12), np.uint8)
LABELS[1:5, 2:8, 3:10] = 1
LABELS[2:4, 4:6, 5:7] = 2
GREY = np.random.default_rng(3).integers(0, 255, (24, 20)).astype(np.uint8)
ROWS = "line,x,y,z,radius_mm\n" + "".join(f"0,{x},{x * 0.5},0,2.5\n" for x in range(12))
LANDMARKS = (
    "# Markups fiducial file version = 4.11\n# CoordinateSystem = LPS\n"
    "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
)


@dataclass(frozen=True)
class Reader:
    """How files of a kind are read, and a file of the kind.

    ``make`` writes into a folder and returns the path that is read; ``changed`` is the file in the folder that gets
    changed, where that is another. Where ``summed``, a sum in the file covers what lies between ``begin`` and ``end``.
    """

    name: str
    read: Callable[[Path], Any]
    make: Callable[[Path], Path]
    changed: str = ""
    begin: Callable[[bytes], int] | None = None
    end: int = 0


def tube() -> Any:
    from registration.geometry.shapes import Mesh

    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    rings = [np.stack([5 * np.cos(angle), 5 * np.sin(angle), np.full(8, 4.0 * z)], axis=1) for z in range(5)]
    faces = [[8 * z + i, 8 * z + (i + 1) % 8, 8 * z + 8 + i] for z in range(4) for i in range(8)]
    faces += [
        [8 * z + (i + 1) % 8, 8 * z + 8 + (i + 1) % 8, 8 * z + 8 + i] for z in range(4) for i in range(8)
    ]
    return Mesh(np.concatenate(rings), np.array(faces, dtype=np.int64))


def written(name: str, content: str | bytes) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        data = content if isinstance(content, bytes) else content.encode()
        (folder / name).write_bytes(data)
        return folder / name

    return make


def _surfaces() -> list[Reader]:
    from registration.io.patient_space import write_model
    from registration.io.surfaces import read_surface, write_surface

    def model(name: str) -> Callable[[Path], Path]:
        def make(folder: Path) -> Path:
            write_model(folder / name, tube())
            return folder / name

        return make

    def cloud(folder: Path) -> Path:
        write_surface(folder / "c.xyz", tube().vertices_mm)
        return folder / "c.xyz"

    def text_ply(folder: Path) -> Path:
        mesh = tube()
        head = f"ply\nformat ascii 1.0\nelement vertex {len(mesh.vertices_mm)}\nproperty float x\nproperty float y\n"
        head += (
            f"property float z\nelement face {len(mesh.triangles)}\nproperty list uchar int vertex_indices\n"
        )
        head += "end_header\n"
        rows = [" ".join(f"{value:g}" for value in point) for point in mesh.vertices_mm]
        rows += [f"3 {a} {b} {c}" for a, b, c in mesh.triangles]
        return written("t.ply", head + "\n".join(rows) + "\n")(folder)

    points = tube().vertices_mm
    obj = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in points)
    obj += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in tube().triangles)
    pcd = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 40\nHEIGHT 1\nPOINTS 40\nDATA binary\n"
    vtk = f"# vtk DataFile Version 3.0\ntube\nASCII\nDATASET POLYDATA\nPOINTS {len(points)} float\n"
    vtk += "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in points)
    vtk += f"POLYGONS {len(tube().triangles)} {4 * len(tube().triangles)}\n"
    vtk += "".join(f"3 {a} {b} {c}\n" for a, b, c in tube().triangles)
    return [
        Reader("PLY, binary", read_surface, model("m.ply")),
        Reader("PLY, text", read_surface, text_ply),
        Reader("STL, binary", read_surface, model("m.stl")),
        Reader("OBJ", read_surface, written("m.obj", obj)),
        Reader("PCD", read_surface, written("c.pcd", pcd.encode() + points.astype("<f4").tobytes())),
        Reader("XYZ", read_surface, cloud),
        Reader("VTK, legacy", read_surface, written("m.vtk", vtk)),
    ]


def _lines() -> list[Reader]:
    from registration.geometry.shapes import Centerline, Polyline
    from registration.io.centerlines import read_centerline_table, write_centerline
    from registration.io.landmarks import Landmarks, read_landmarks, write_landmarks
    from registration.io.surfaces import read_centerline

    def vtp(folder: Path) -> Path:
        line = np.stack([np.linspace(0, 50, 60), np.sin(np.linspace(0, 9, 60)), np.zeros(60)], axis=1)
        write_centerline(folder / "c.vtp", Centerline((Polyline(line, np.full(60, 3.0)),)))
        return folder / "c.vtp"

    def markups(folder: Path) -> Path:
        write_landmarks(folder / "l.mrk.json", Landmarks(("a", "b", "c"), np.eye(3)))
        return folder / "l.mrk.json"

    rows = "".join(f"{n},{n}.5,2,3,0,0,0,1,1,1,0,p{n},,\n" for n in range(4))
    return [
        Reader(
            "VTP, centerline",
            read_centerline,
            vtp,
            begin=lambda data: data.index(b"_", data.index(b"<App")) + 1,
            end=40,
        ),
        Reader("centerline table", read_centerline_table, written("c.csv", ROWS)),
        Reader("landmarks, JSON", read_landmarks, markups),
        Reader("landmarks, FCSV", read_landmarks, written("l.fcsv", LANDMARKS + rows)),
    ]


def _transforms() -> list[Reader]:
    from registration.io.displacement_fields import (
        DisplacementGrid,
        read_displacement_grid,
        write_displacement_grid,
        write_displacement_transform,
    )
    from registration.io.sampled_displacement import read_sampled_displacement
    from registration.io.transforms import read_transform, write_transform

    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3
    field = np.random.default_rng(2).normal(0, 1, (4, 4, 4, 3))
    grid = DisplacementGrid(np.zeros(3), np.full(3, 5.0), field)

    def itk(name: str) -> Callable[[Path], Path]:
        def make(folder: Path) -> Path:
            write_transform(folder / name, pose)
            return folder / name

        return make

    def image(name: str) -> Callable[[Path], Path]:
        def make(folder: Path) -> Path:
            write_displacement_grid(folder / name, grid, "lps")
            return folder / name

        return make

    def transform(folder: Path) -> Path:
        write_displacement_transform(folder / "f.h5", grid, "lps")
        return folder / "f.h5"

    text = "\n".join(" ".join(map(str, row)) for row in pose)
    return [
        Reader(
            "transform, JSON",
            read_transform,
            written("t.json", json.dumps({"fixed_T_moving": pose.tolist()})),
        ),
        Reader("transform, text", read_transform, written("t.txt", text)),
        Reader("transform, TFM", read_transform, itk("t.tfm")),
        Reader("transform, HDF5", read_transform, itk("t.h5")),
        Reader("displacement, NRRD", lambda path: read_displacement_grid(path, "lps"), image("f.nrrd")),
        Reader("displacement, MHA", lambda path: read_displacement_grid(path, "lps"), image("f.mha")),
        Reader("displacement, HDF5", read_sampled_displacement, transform),
    ]


def _volumes() -> list[Reader]:
    from registration.ct_model.label_map import read_label_map
    from registration.io.volumes import read_volume

    def values(path: Path) -> np.ndarray:
        import SimpleITK

        return np.asarray(SimpleITK.GetArrayFromImage(read_volume(path)))

    def packed(name: str) -> Callable[[Path], Path]:
        def make(folder: Path) -> Path:
            import SimpleITK

            SimpleITK.WriteImage(SimpleITK.GetImageFromArray(LABELS), str(folder / name), True)
            return folder / name

        return make

    head = "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 12 10 6\nencoding: bzip2\n"
    head += "space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\n\n"
    after_blank = lambda data: data.index(b"\n\n") + 2  # noqa: E731
    return [
        Reader("volume, MHA", values, packed("v.mha"), begin=lambda data: data.index(b"LOCAL\n") + 6),
        Reader("volume, MHD", values, packed("v.mhd"), changed="v.zraw", begin=lambda data: 0),
        Reader("volume, header of MHD", values, packed("v.mhd")),
        Reader("volume, NRRD gzip", values, packed("v.nrrd"), begin=after_blank),
        Reader(
            "volume, NRRD bzip2",
            values,
            written("b.nrrd", head.encode() + bz2.compress(LABELS.tobytes())),
            begin=after_blank,
        ),
        Reader("volume, NIfTI", values, packed("v.nii")),
        Reader("volume, NIfTI gzip", values, packed("v.nii.gz"), begin=lambda data: 10),
        Reader("label map", lambda path: read_label_map(path, None, None, None), packed("l.nrrd")),
    ]


def _sweeps() -> list[Reader]:
    from plus_sequences import tracked_sequence
    from sweeps import CALIBRATION, known_sweep

    from registration.readers.chain.graph import TransformGraph
    from registration.readers.folder import FolderReader, write_folder
    from registration.readers.plus.calibration_file import calibration_yaml, read_calibration
    from registration.readers.plus.config import device_set_xml, read_device_set
    from registration.readers.plus.fields import read_sequence, write_sequence
    from registration.readers.rosbag.reader import RosbagReader
    from registration.readers.rosbag.writer import write_bag

    def sequence(name: str) -> Callable[[Path], Path]:
        def make(folder: Path) -> Path:
            write_sequence(folder / name, tracked_sequence())
            return folder / name

        return make

    def pixels(path: Path) -> np.ndarray:
        return read_sequence(path).pixels

    def plain(folder: Path) -> Path:
        write_folder(folder / "sweep", known_sweep())
        return folder / "sweep"

    def bag(kind: str) -> Callable[[Path], Path]:
        def make(folder: Path) -> Path:
            write_bag(folder / "bag", known_sweep(), storage=kind)
            return folder / "bag"

        return make

    bags = RosbagReader(image_topic="/us/image", pose_topic="/robot/ee_pose")
    device_set = device_set_xml(TransformGraph({("Image", "Probe"): CALIBRATION.probe_A_pixel}))
    return [
        Reader("sequence, MHA", pixels, sequence("s.igs.mha"), begin=lambda data: data.index(b"LOCAL\n") + 6),
        Reader("sequence, NRRD", pixels, sequence("s.igs.nrrd"), begin=lambda data: data.index(b"\n\n") + 2),
        *(
            Reader(f"sweep folder, {name}", FolderReader(), plain, changed=f"sweep/{name}")
            for name in ("sweep.yaml", "poses.csv", "frames.csv")
        ),
        Reader("bag, SQLite", bags, bag("sqlite3"), changed="bag/bag.db3"),
        Reader("bag, MCAP", bags, bag("mcap"), changed="bag/bag.mcap"),
        Reader("bag, metadata", bags, bag("sqlite3"), changed="bag/metadata.yaml"),
        Reader("calibration, YAML", read_calibration, written("c.yaml", calibration_yaml(CALIBRATION))),
        Reader("device set, XML", read_device_set, written("d.xml", device_set)),
    ]


def _pictures() -> list[Reader]:
    from dicom_files import write_dicom

    from experiments.datasets.images.decoding import decode
    from experiments.datasets.images.dicom import read_dicom
    from registration.readers.streams.image_files import decode_image

    def picture(name: str, **options: Any) -> Callable[[Path], Path]:
        def make(folder: Path) -> Path:
            Image.fromarray(GREY).save(folder / name, **options)
            return folder / name

        return make

    def dicom(folder: Path) -> Path:
        write_dicom(folder / "d.dcm", GREY[None])
        return folder / "d.dcm"

    def begin(data: bytes) -> int:
        return data.index(b"IDAT") + 4

    return [
        Reader("frame, PNG", lambda path: decode_image(path, str(path)), picture("f.png"), begin=begin),
        Reader("image, PNG", lambda path: decode(path).values, picture("i.png"), begin=begin),
        Reader("image, JPEG", decode, picture("i.jpg")),
        Reader("image, BMP", decode, picture("i.bmp")),
        Reader(
            "image, TIFF",
            lambda path: decode(path).values,
            picture("i.tif", compression="tiff_adobe_deflate"),
        ),
        Reader("image, TIFF LZW", decode, picture("z.tif", compression="tiff_lzw")),
        Reader("DICOM", read_dicom, dicom),
    ]


def _tables() -> list[Reader]:
    from experiments.datasets.csv_tables import read_table
    from experiments.datasets.group_table import read_groups
    from experiments.datasets.nnunet import _described
    from experiments.splits.split_set import SplitSet
    from experiments.studies.reconstruct.masks import _array
    from models.labelled_frames import LabelledFrames
    from models.settings_file import read_settings

    def npz(folder: Path) -> Path:
        frames = LabelledFrames(
            (GREY,) * 2, (GREY > 100,) * 2, ("a", "b"), ("a", "b"), (None, (0.1, 0.1)), True
        )
        frames.save(folder / "f.npz")
        return folder / "f.npz"

    def npy(folder: Path) -> Path:
        np.save(folder / "m.npy", GREY[None] > 100)
        return folder / "m.npy"

    described = {
        "channel_names": {"0": "US"},
        "labels": {"background": 0, "vessel": 1},
        "file_ending": ".png",
    }
    fold = {"fold": 0, "folds": 1, "train": ["a"], "validation": ["b"], "test": ["c"]}
    folds = {"groups": {"a": "a", "b": "b", "c": "c"}, "folds": [fold]}
    table = "case,group,vertical_mm,horizontal_mm\na,g,0.1,0.1\nb,h,,\n"
    return [
        Reader("table, CSV", lambda path: read_table(path, ("case", "group")), written("t.csv", table)),
        Reader("groups, CSV", lambda path: read_groups(path, ("a", "b")), written("g.csv", table)),
        Reader("splits, JSON", SplitSet.read, written("s.json", json.dumps(folds))),
        Reader(
            "dataset.json", lambda path: _described(path, "vessel"), written("d.json", json.dumps(described))
        ),
        Reader("masks, NPY", _array, npy),
        Reader("frames, NPZ", LabelledFrames.load, npz),
        Reader(
            "training, YAML", read_settings, written("t.yaml", "model:\n  name: unet\n  width: 8\nseed: 1\n")
        ),
    ]


def _archives() -> list[Reader]:
    import pandas as pd

    from experiments.files import read_table
    from experiments.tracking.archive import read_archive, write_archive
    from experiments.tracking.run_record import RunRecord
    from models.checkpoint import Checkpoint
    from models.networks.registry import recipe_of
    from models.preprocessing.preprocessing import Preprocessing

    def model(folder: Path) -> Path:
        recipe = recipe_of("unet", {"width": 1})
        Checkpoint(recipe, recipe().state_dict(), Preprocessing(16)).save(folder / "m.pt")
        return folder / "m.pt"

    def archive(folder: Path) -> Path:
        history = pd.DataFrame([("dsc", 0, 0.5, 1)], columns=["metric", "step", "value", "timestamp_ms"])
        cases = pd.DataFrame({"case_id": ["a"], "dsc": [0.5]})
        record = RunRecord(
            "r1", "study", "run", "FINISHED", 1, 2, None, {}, {"a": "1"}, "a: 1\n", history, cases
        )
        write_archive([record], folder / "runs")
        return folder / "runs"

    def table(folder: Path) -> Path:
        pd.DataFrame({"case_id": ["a", "b"], "dsc": [0.5, 0.75], "name": ["x", None]}).to_parquet(
            folder / "cases.parquet"
        )
        return folder / "cases.parquet"

    return [
        Reader("model", Checkpoint.load, model),
        Reader("table, Parquet", read_table, table),
        *(
            Reader(
                f"run archive, {name}",
                lambda path: list(read_archive(path)),
                archive,
                changed=f"runs/study/{name}",
            )
            for name in ("runs.parquet", "history.parquet", "cases/r1.parquet")
        ),
    ]


GROUPS = {
    "surfaces": _surfaces, "lines": _lines, "transforms": _transforms, "volumes": _volumes, "sweeps": _sweeps,
    "pictures": _pictures, "tables": _tables, "archives": _archives,
}  # fmt: skip


def readers(*groups: str) -> list[Reader]:
    """The readers of these groups, or of all."""
    return [reader for group in groups or GROUPS for reader in GROUPS[group]()]
