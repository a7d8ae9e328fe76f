"""Tracked sweeps in a plain folder that any laboratory can write.

``frames/``: images (PNG, JPEG, BMP or TIFF), orientation MF, in the natural order of their names.
``poses.csv``: header ``timestamp_s,tx,ty,tz,qx,qy,qz,qw``; a row a pose of the end effector in the world, position
in mm, unit quaternion (scaled to length 1 where it is off by at most 1 %), rows in the order of time.
``sweep.yaml``: ``probe_A_pixel`` and ``ee_T_probe`` (four rows of four numbers; mm), and, if wanted, ``units`` (``mm``
or ``m``, of positions and of ``ee_T_probe``'s), ``orientation``, ``frame_rate_hz`` and ``first_frame_s``.
``frames.csv``: header ``file,timestamp_s``; a row a frame. Without it the frames come at ``frame_rate_hz`` from
``first_frame_s``; without that there must be a pose a frame, at whose times they are taken.
"""

from __future__ import annotations

import csv
import difflib
import io
import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, UInt8
from PIL import Image
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.errors import InputError
from registration.input_files import refusing
from registration.io.atomic import atomic_folder
from registration.readers.plus.calibration_file import calibration_from, calibration_yaml, read_yaml
from registration.readers.plus.sequence import to_mf
from registration.readers.streams.checks import distinct_times
from registration.readers.streams.image_files import decode_image, grey_stack, list_images
from registration.readers.streams.pose_values import MM_PER_UNIT, require_unit, span_mm, unit_quaternions
from registration.sweep import ProbeCalibration, TrackedSweep
from registration.text_files import parse_number, read_text

POSE_COLUMNS = ("timestamp_s", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
FRAME_COLUMNS = ("file", "timestamp_s")
UNLISTED = "image without a row in frames.csv"
SETTINGS = ("probe_A_pixel", "ee_T_probe", "units", "orientation", "frame_rate_hz", "first_frame_s")
# Poses this far apart are of no robot's sweep, whatever unit is stated.
_WIDEST_SWEEP_MM = 20_000.0
# A lever between end effector and probe is either nothing or longer than a millimetre.
_MIN_LEVER_MM = 1.0


@dataclass(frozen=True)
class FolderReader:
    """Read a tracked sweep from a plain folder (see the module's description of it)."""

    def __call__(self, path: Path) -> TrackedSweep:
        """Read a sweep.

        Parameters
        ----------
        path : Path
            Folder of the sweep.

        Returns
        -------
        TrackedSweep
            Frames and poses as recorded.

        Raises
        ------
        InputError
            If a file is missing or is not what it must be; the message names the file, what was expected and
            what was found.
        """
        if not path.is_dir():
            raise InputError(f"{path}: expected a folder with frames/, poses.csv and sweep.yaml, found none")
        with refusing(path, "a folder of a tracked sweep"):
            return self._read(path)

    def _read(self, path: Path) -> TrackedSweep:
        settings_path = path / "sweep.yaml"
        settings = read_yaml(settings_path)
        for name in settings:
            # Keys of other programs may stand there too; one that is nearly ours is a slip.
            if name not in SETTINGS and (meant := difflib.get_close_matches(str(name), SETTINGS, 1, 0.8)):
                raise InputError(
                    f"{settings_path}: expected keys such as {', '.join(SETTINGS)}, found {name!r}; did you mean "
                    f"{meant[0]}?"
                )
        unit = settings.get("units")
        if unit is not None and not (isinstance(unit, str) and unit in MM_PER_UNIT):
            raise InputError(f"{settings_path}: expected units mm or m, found {unit!r}")
        scale = MM_PER_UNIT[unit or "mm"]
        calibration = _scaled(calibration_from(settings, str(settings_path)), scale)
        pose_times_s, world_T_ee = _read_poses(path / "poses.csv", scale)
        if unit is None:
            setting = f"say units: m, or units: mm, in {settings_path.name}"
            require_unit(world_T_ee[:, :3, 3], "mm", str(path / "poses.csv"), setting)
            _require_lever(calibration, settings_path)
        elif (span := span_mm(world_T_ee[:, :3, 3])) > _WIDEST_SWEEP_MM:
            raise InputError(
                f"{path / 'poses.csv'}: expected poses within {_WIDEST_SWEEP_MM / 1000:g} m, found a span of "
                f"{span / 1000:.3g} m by units: {unit} in {settings_path.name}"
            )
        files, image_times_s, unlisted = _frame_times(path, settings, pose_times_s)
        pose_times_s, world_T_ee = distinct_times(pose_times_s, world_T_ee, str(path / "poses.csv"))
        images = _read_images(files)
        if len(images) and "orientation" in settings:
            images = to_mf(images, str(settings["orientation"]), settings_path)
        dropped = {UNLISTED: unlisted} if unlisted else {}
        return TrackedSweep(images, image_times_s, world_T_ee, pose_times_s, calibration, dropped)


def write_folder(path: Path, sweep: TrackedSweep) -> None:
    """Write a sweep as a plain folder; both streams keep their own times.

    Parameters
    ----------
    path : Path
        Folder, which must be absent or empty.
    sweep : TrackedSweep
        Sweep; all of it is written but the counts of what was dropped.

    Raises
    ------
    InputError
        If there is a folder with content, or the frames differ in calibration.
    """
    sweep.require_one_calibration("a plain folder")
    with atomic_folder(path) as stage:
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
    """List the names, without suffix, of a sweep's frames in their order.

    Parameters
    ----------
    path : Path
        Plain folder, or one that holds a sweep under the name ``sweep``.

    Returns
    -------
    tuple of str or None
        Names; None where the sweep is not a plain folder.
    """
    for folder in (path, path / "sweep"):
        if (folder / "sweep.yaml").is_file():
            table = folder / "frames.csv"
            if table.exists():
                return tuple(Path(row[0]).stem for row in _read_csv(table, FRAME_COLUMNS))
            return tuple(file.stem for file in list_images(folder / "frames"))
    return None


def _require_lever(calibration: ProbeCalibration, path: Path) -> None:
    lever_mm = float(np.linalg.norm(calibration.ee_T_probe[:3, 3]))
    if 0 < lever_mm < _MIN_LEVER_MM:
        raise InputError(
            f"{path}: expected ee_T_probe in millimetres, found a lever of {lever_mm:.3g} mm "
            "(was it metres? say units: m, or units: mm)"
        )


def _scaled(calibration: ProbeCalibration, scale: float) -> ProbeCalibration:
    """The end effector's lever brought to mm; pixels are always given in mm."""
    ee_T_probe = calibration.ee_T_probe.copy()
    ee_T_probe[:3, 3] *= scale
    return replace(calibration, ee_T_probe=ee_T_probe)


def _read_poses(path: Path, scale: float) -> tuple[Float64[np.ndarray, " m"], Float64[np.ndarray, "m 4 4"]]:
    rows = _read_csv(path, POSE_COLUMNS)
    try:
        values = np.array([[parse_number(entry) for entry in row] for row in rows], dtype=np.float64)
        values = values.reshape(-1, len(POSE_COLUMNS))
    except ValueError as failure:
        raise InputError(f"{path}: expected numbers, found {failure}") from failure
    if not len(values):
        raise InputError(f"{path}: expected at least one pose, found none")
    if not np.isfinite(values).all():
        line = int(np.argwhere(~np.isfinite(values))[0][0]) + 2
        raise InputError(f"{path}: expected finite numbers, found NaN or infinity in line {line}")
    off = np.flatnonzero(~unit_quaternions(values[:, 4:]))
    if len(off):
        raise InputError(
            f"{path}: expected unit quaternions, found one of length "
            f"{np.linalg.norm(values[off[0], 4:]):.4g} in line {off[0] + 2}"
        )
    rotation = Rotation.from_quat(values[:, 4:])
    return values[:, 0].copy(), transforms.from_rotation(rotation, values[:, 1:4] * scale)


def _frame_times(
    path: Path, settings: dict[str, Any], pose_times_s: Float64[np.ndarray, " m"]
) -> tuple[list[Path], Float64[np.ndarray, " n"], int]:
    """The image files, the time of each, and how many images have no row in frames.csv."""
    table = path / "frames.csv"
    if table.exists():
        files, times_s = _listed_frames(table)
        return files, times_s, len(set(list_images(path / "frames")) - set(files))
    files = list_images(path / "frames")
    if "frame_rate_hz" in settings:
        rate_hz, first_s = settings["frame_rate_hz"], settings.get("first_frame_s", 0.0)
        if not (isinstance(rate_hz, (int, float)) and rate_hz > 0 and isinstance(first_s, (int, float))):
            raise InputError(f"{path / 'sweep.yaml'}: expected frame_rate_hz above 0, found {rate_hz!r}")
        return files, first_s + np.arange(len(files)) / rate_hz, 0
    if len(files) != len(pose_times_s):
        raise InputError(
            f"{path}: expected frames.csv, or frame_rate_hz in sweep.yaml, or a pose for each frame, "
            f"found {len(files)} frames and {len(pose_times_s)} poses"
        )
    return files, pose_times_s.copy(), 0


def _listed_frames(table: Path) -> tuple[list[Path], Float64[np.ndarray, " n"]]:
    rows = _read_csv(table, FRAME_COLUMNS)
    try:
        times_s = np.array([parse_number(row[1]) for row in rows], dtype=np.float64)
    except ValueError as failure:
        raise InputError(f"{table}: expected numbers for timestamp_s, found {failure}") from failure
    if not np.isfinite(times_s).all():
        raise InputError(f"{table}: expected finite timestamps, found NaN or infinity")
    # A table from Windows may name files with their folder.
    files = [table.parent / "frames" / Path(row[0].replace("\\", "/")).name for row in rows]
    twice = next((file.name for file, other in itertools.pairwise(sorted(files)) if file == other), None)
    if twice is not None:
        raise InputError(f"{table}: expected each file once, found {twice} twice")
    return files, times_s


def _read_images(files: list[Path]) -> UInt8[np.ndarray, "n height width"]:
    images: list[np.ndarray] = []
    for file in files:
        images.append(decode_image(file, str(file)))
        if images[-1].shape[:2] != images[0].shape[:2]:
            raise InputError(
                f"{file}: expected the size of {files[0].name}, {images[0].shape[1]}x{images[0].shape[0]} pixels, "
                f"found {images[-1].shape[1]}x{images[-1].shape[0]}"
            )
    return grey_stack(images, str(files[0].parent)) if images else np.zeros((0, 0, 0), dtype=np.uint8)


def _read_csv(path: Path, columns: tuple[str, ...]) -> list[list[str]]:
    """The named columns of a table, in that order, whatever their order in the file."""
    try:
        lines = [row for row in csv.reader(io.StringIO(read_text(path)), skipinitialspace=True) if any(row)]
    except csv.Error as failure:
        raise InputError(f"{path}: expected a readable table, found {failure}") from failure
    header = [name.strip() for name in lines[0]] if lines else []
    places = [place for place, name in enumerate(header) if name in columns]
    if sorted(header[place] for place in places) != sorted(columns):
        raise InputError(
            f"{path}: expected the columns {', '.join(columns)}, found {', '.join(header) or 'none'}"
        )
    for number, row in enumerate(lines[1:], start=2):
        # Numbers with decimal commas fall into twice as many fields, and would go to the wrong columns.
        if len(row) < len(header) or any(entry.strip() for entry in row[len(header) :]):
            raise InputError(
                f"{path}: expected {len(header)} fields in every row, found {len(row)} in row {number}"
            )
    at = {header[place]: place for place in places}
    return [[row[at[name]].strip() for name in columns] for row in lines[1:]]


def _write_csv(path: Path, columns: tuple[str, ...], rows: list[list[str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
