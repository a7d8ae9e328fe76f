"""Tracked sweeps in a plain folder that any laboratory can write.

``frames/*.png``: grey images, orientation MF, in the order of their names.
``poses.csv``: header ``timestamp_s,tx,ty,tz,qx,qy,qz,qw``; a row a pose of the end effector in the world, position
in mm, unit quaternion, rows in the order of time.
``sweep.yaml``: ``probe_A_pixel`` and ``ee_T_probe`` (four rows of four numbers; mm), and, if wanted, ``units`` (``mm``
or ``m``, of positions and of ``ee_T_probe``'s), ``orientation``, ``frame_rate_hz`` and ``first_frame_s``.
``frames.csv``: header ``file,timestamp_s``; a row a frame. Without it the frames come at ``frame_rate_hz`` from
``first_frame_s``; without that there must be a pose a frame, at whose times they are taken.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, UInt8
from PIL import Image, UnidentifiedImageError
from scipy.spatial.transform import Rotation

from registration import frames
from registration.errors import InputError
from registration.readers.calibration_file import calibration_from, calibration_yaml, read_yaml
from registration.readers.sequence import to_mf
from registration.readers.streams import as_grey, distinct_times
from registration.sweep import TrackedSweep
from registration.whole import whole_folder

POSE_COLUMNS = ("timestamp_s", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
FRAME_COLUMNS = ("file", "timestamp_s")
_MM = {"mm": 1.0, "m": 1000.0}
# No end effector keeps within 3 mm of its robot's base: such positions were written in metres.
_LEAST_REACH_MM = 3.0
_QUATERNION_TOLERANCE = 1e-3


@dataclass(frozen=True)
class FolderReader:
    """Read a tracked sweep from a plain folder (see the module's description of it)."""

    def __call__(self, path: Path) -> TrackedSweep:
        """Read the sweep. Each refusal names the file, what was expected and what was found."""
        if not path.is_dir():
            raise InputError(f"{path}: expected a folder with frames/, poses.csv and sweep.yaml, found none")
        settings_path = path / "sweep.yaml"
        settings = read_yaml(settings_path)
        unit = settings.get("units")
        if unit is not None and unit not in _MM:
            raise InputError(f"{settings_path}: expected units mm or m, found {unit!r}")
        scale = _MM[unit or "mm"]
        calibration = calibration_from(_scaled(settings, scale), str(settings_path))
        pose_times_s, world_T_ee = _read_poses(path / "poses.csv", scale)
        reach_mm = float(np.abs(world_T_ee[:, :3, 3]).max(initial=0))
        if unit is None and 0 < reach_mm < _LEAST_REACH_MM:
            raise InputError(
                f"{path / 'poses.csv'}: expected positions in millimetres, found all within {reach_mm:.3g} of the "
                f"origin (were they metres? say units: m, or units: mm, in {settings_path.name})"
            )
        files, image_times_s = _frame_times(path, settings, pose_times_s)
        pose_times_s, world_T_ee = distinct_times(pose_times_s, world_T_ee, str(path / "poses.csv"))
        images = _read_images(files)
        if len(images) and "orientation" in settings:
            images = to_mf(images, str(settings["orientation"]), settings_path)
        return TrackedSweep(images, image_times_s, world_T_ee, pose_times_s, calibration)


def write_folder(path: Path, sweep: TrackedSweep) -> None:
    """Write a sweep as a plain folder; both streams keep their own times, nothing is lost but what was dropped."""
    sweep.require_one_calibration("a plain folder")
    with whole_folder(path) as stage:
        (stage / "frames").mkdir()
        names = [f"{index:06d}.png" for index in range(len(sweep.images))]
        for name, image in zip(names, sweep.images, strict=True):
            Image.fromarray(image).save(stage / "frames" / name)
        quaternions = Rotation.from_matrix(sweep.world_T_ee[:, :3, :3]).as_quat()
        rows = np.column_stack([sweep.pose_times_s, sweep.world_T_ee[:, :3, 3], quaternions])
        _write_csv(stage / "poses.csv", POSE_COLUMNS, [[repr(float(value)) for value in row] for row in rows])
        times = [repr(float(time_s)) for time_s in sweep.image_times_s]
        _write_csv(stage / "frames.csv", FRAME_COLUMNS, [list(row) for row in zip(names, times, strict=True)])
        text = "units: mm\norientation: MF\n" + calibration_yaml(sweep.calibration)
        (stage / "sweep.yaml").write_text(text, encoding="utf-8")


def frame_names(path: Path) -> tuple[str, ...] | None:
    """The names, without suffix, of a sweep's frames in their order; None where the sweep is not a plain folder.

    A folder that holds a sweep under the name ``sweep`` stands for that.
    """
    for folder in (path, path / "sweep"):
        if (folder / "sweep.yaml").is_file():
            table = folder / "frames.csv"
            if table.exists():
                return tuple(Path(row[0]).stem for row in _read_csv(table, FRAME_COLUMNS))
            return tuple(file.stem for file in sorted((folder / "frames").glob("*.png")))
    return None


def _scaled(settings: dict[str, Any], scale: float) -> dict[str, Any]:
    """The settings with the end effector's lever brought to mm; pixels are always given in mm."""
    if scale == 1.0 or "ee_T_probe" not in settings:
        return settings
    rows = [list(row) for row in settings["ee_T_probe"]]
    for row in rows[:3]:
        row[3] = row[3] * scale
    return {**settings, "ee_T_probe": rows}


def _read_poses(path: Path, scale: float) -> tuple[Float64[np.ndarray, "m"], Float64[np.ndarray, "m 4 4"]]:
    rows = _read_csv(path, POSE_COLUMNS)
    try:
        values = np.array(rows, dtype=np.float64).reshape(-1, len(POSE_COLUMNS))
    except ValueError as failure:
        raise InputError(f"{path}: expected numbers, found {failure}") from failure
    if not len(values):
        raise InputError(f"{path}: expected at least one pose, found none")
    if not np.isfinite(values).all():
        line = int(np.argwhere(~np.isfinite(values))[0][0]) + 2
        raise InputError(f"{path}: expected finite numbers, found NaN or infinity in line {line}")
    norms = np.linalg.norm(values[:, 4:], axis=1)
    if (np.abs(norms - 1) > _QUATERNION_TOLERANCE).any():
        at = int(np.abs(norms - 1).argmax())
        raise InputError(
            f"{path}: expected unit quaternions, found one of length {norms[at]:.4g} in line {at + 2}"
        )
    rotation = Rotation.from_quat(values[:, 4:])
    return values[:, 0].copy(), frames.from_rotation(rotation, values[:, 1:4] * scale)


def _frame_times(
    path: Path, settings: dict[str, Any], pose_times_s: Float64[np.ndarray, "m"]
) -> tuple[list[Path], Float64[np.ndarray, "n"]]:
    """The image files and the time of each."""
    table = path / "frames.csv"
    if table.exists():
        rows = _read_csv(table, FRAME_COLUMNS)
        try:
            times_s = np.array([float(row[1]) for row in rows], dtype=np.float64)
        except ValueError as failure:
            raise InputError(f"{table}: expected numbers for timestamp_s, found {failure}") from failure
        if not np.isfinite(times_s).all():
            raise InputError(f"{table}: expected finite timestamps, found NaN or infinity")
        return [path / "frames" / Path(row[0]).name for row in rows], times_s
    files = sorted((path / "frames").glob("*.png"))
    if "frame_rate_hz" in settings:
        rate_hz, first_s = settings["frame_rate_hz"], settings.get("first_frame_s", 0.0)
        if not (isinstance(rate_hz, (int, float)) and rate_hz > 0 and isinstance(first_s, (int, float))):
            raise InputError(f"{path / 'sweep.yaml'}: expected frame_rate_hz above 0, found {rate_hz!r}")
        return files, first_s + np.arange(len(files)) / rate_hz
    if len(files) != len(pose_times_s):
        raise InputError(
            f"{path}: expected frames.csv, or frame_rate_hz in sweep.yaml, or a pose for each frame, "
            f"found {len(files)} frames and {len(pose_times_s)} poses"
        )
    return files, pose_times_s.copy()


def _read_images(files: list[Path]) -> UInt8[np.ndarray, "n height width"]:
    images: list[np.ndarray] = []
    for file in files:
        try:
            with Image.open(file) as image:
                pixels = np.asarray(
                    image.convert("L") if image.mode in ("1", "P", "RGBA", "LA", "RGB") else image
                )
        except (OSError, UnidentifiedImageError) as failure:
            raise InputError(f"{file}: expected a readable PNG image, found {failure}") from failure
        images.append(as_grey(pixels[None], str(file))[0])
        if images[-1].shape != images[0].shape:
            raise InputError(
                f"{file}: expected the size of {files[0].name}, {images[0].shape[1]}x{images[0].shape[0]} pixels, "
                f"found {images[-1].shape[1]}x{images[-1].shape[0]}"
            )
    return np.stack(images) if images else np.zeros((0, 0, 0), dtype=np.uint8)


def _read_csv(path: Path, columns: tuple[str, ...]) -> list[list[str]]:
    """The named columns of a table, in that order, whatever their order in the file."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            table = csv.DictReader(stream, skipinitialspace=True)
            header = [name.strip() for name in table.fieldnames or ()]
            table.fieldnames = header
            missing = [name for name in columns if name not in header]
            if missing:
                raise InputError(
                    f"{path}: expected the columns {', '.join(columns)}, found {', '.join(header) or 'none'}"
                )
            return [[(row[name] or "").strip() for name in columns] for row in table]
    except (OSError, UnicodeDecodeError) as failure:
        raise InputError(f"{path}: expected a readable table, found {failure}") from failure


def _write_csv(path: Path, columns: tuple[str, ...], rows: list[list[str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
