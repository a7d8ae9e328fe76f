"""Values that the PLUS toolkit published for its test data, compared with those computed here.

The published values stand in the files themselves (results of calibrations, reconstructed volumes, baselines
of tests) or in the toolkit's tests (bounds of interpolated poses).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

    from registration.readers.plus.results import WireCalibrationFile

_FCAL2 = "FreehandCalibration3NWires_fCal2.0.results.xml"
_FCAL1 = "FreehandCalibration3NWires.results.xml"
# The first fCal phantom: holes E to K lie 5 mm apart from x = 20 mm, rows 2, 3, 4 at z = 10, 5, 0 mm, fronts (capital
# letters) at y = 0, backs at y = 40 mm; PLUS's device sets give the same for the wires of rows 3 and 4.
_FCAL1_WIRES = ("E2e2", "I2f2", "J2j2", "E3e3", "F3j3", "K3k3", "E4e4", "J4f4", "K4k4")
_LAG_S, _LAG_TOLERANCE_S = -0.0648, 0.005


@dataclass(frozen=True)
class Value:
    """A published value or bound compared with the value computed here.

    Parameters
    ----------
    file : str
        File of the test data.
    quantity : str
        What is compared, with its unit.
    published : float
        Published value or bound; NaN where there is none.
    ours : float
        Value computed here.
    kind : {"equal", "below", "report"}, optional
        Whether ours must be within ``tolerance`` of the value, below the bound, or nothing was published.
    tolerance : float, optional
        Largest absolute difference for ``equal``.
    """

    file: str
    quantity: str
    published: float
    ours: float
    kind: str = "equal"
    tolerance: float = 0.0

    @property
    def met(self) -> bool | None:
        """Whether the value is met; None where nothing was published."""
        if self.kind == "report":
            return None
        return (
            self.ours < self.published
            if self.kind == "below"
            else abs(self.ours - self.published) <= self.tolerance
        )

    @property
    def published_text(self) -> str:
        """The published value or bound as text for the table."""
        if self.kind == "report":
            return "-"
        if self.kind == "below":
            return f"< {self.published:g}"
        return f"{self.published:g}" + (f" ± {self.tolerance:g}" if self.tolerance else "")


def reading_values(plus: Path) -> Iterator[Value]:
    """Compare what is read: frame counts, invalid transforms, recordings of poses alone, a stylus.

    Parameters
    ----------
    plus : Path
        Folder of PLUS's test data.

    Yields
    ------
    Value
        One comparison.
    """
    from registration.readers.plus.config import read_device_set
    from registration.readers.plus.fields import frame_transform, read_sequence
    from registration.readers.plus.reader import PlusReader

    for name, count in (("BoneUltrasound_L14.igs.mha", 21), ("NrrdSample.igs.nrrd", 1)):
        yield Value(name, "frames", count, len(read_sequence(plus / name).frame_fields))
    name = "NwirePhantomFreehand.igs.mha"
    invalid = ~frame_transform(read_sequence(plus / name), "Stylus", "Tracker", name)[1]
    yield Value(name, "frames with an INVALID stylus", 97, int(invalid.sum()))
    for name, count in (("SyntheticTrackerBuffer20.igs.mha", 20), ("Prostate10_tracker.igs.mha", 10)):
        poses = PlusReader(ee="Tool", world="Tracker")(plus / name).world_T_ee
        yield Value(name, "poses of Tool in Tracker", count, len(poses))
    stylus = read_device_set(plus / "StylusCalibration.results.xml").transforms.chain("StylusTip", "Stylus")
    yield Value("StylusCalibration.results.xml", "tip_x_mm", 210.019, float(stylus[0, 3]), tolerance=1e-3)


def interpolation_values(plus: Path) -> Iterator[Value]:
    """Compare the largest jump between poses at five times the recorded rate, as PLUS tests it.

    Parameters
    ----------
    plus : Path
        Folder of PLUS's test data.

    Yields
    ------
    Value
        One comparison.
    """
    from registration import transforms
    from registration.readers.plus.fields import frame_times_s, frame_transform, read_sequence

    name = "TransformInterpolationTest.igs.mha"
    sequence = read_sequence(plus / name)
    matrices, valid = frame_transform(sequence, "Probe", "Tracker", name)
    times_s = frame_times_s(sequence, "filtered", name)[valid]
    between_s = np.linspace(times_s[0], times_s[-1], 5 * len(times_s))
    poses = transforms.interpolate(between_s, times_s, transforms.nearest_rigid(matrices[valid]))
    step = transforms.invert_rigid(poses[:-1]) @ poses[1:]
    yield Value(name, "largest jump_mm", 0.5, float(np.linalg.norm(step[:, :3, 3], axis=1).max()), "below")
    yield Value(name, "largest jump_deg", 1.0, float(transforms.rotation_angle_deg(step).max()), "below")


def temporal_values(plus: Path) -> Iterator[Value]:
    """Compare the tracker's lag in the water tank, from our line and from PLUS's, and the lines' distance.

    Parameters
    ----------
    plus : Path
        Folder of PLUS's test data.

    Yields
    ------
    Value
        One comparison.
    """
    from registration.calibration.line_detection import LineDetector
    from registration.calibration.temporal import TemporalCalibration, principal_motion_mm
    from registration.readers.plus.reader import PlusReader
    from registration.readers.plus.results import read_line_rows_px

    name = "WaterTankBottomTranslationVideoBuffer.igs.mha"
    tracker = str(plus / "WaterTankBottomTranslationTrackerBuffer.igs.mha")
    sweep = PlusReader(tracker=tracker, uncalibrated=True)(plus / name)
    rows_px = LineDetector()(sweep.images)
    baseline_px = read_line_rows_px(
        plus / "LineSegmentationResultsBaseline.xml", (sweep.images.shape[2] - 1) / 2
    )
    near = (sweep.pose_times_s > sweep.image_times_s[0] - 1) & (
        sweep.pose_times_s < sweep.image_times_s[-1] + 1
    )
    motion_mm = principal_motion_mm(sweep.world_T_ee[near, :3, 3])
    for whose, signal in (("our line", rows_px), ("PLUS's line", baseline_px)):
        found = TemporalCalibration()(sweep.image_times_s, signal, sweep.pose_times_s[near], motion_mm)
        yield Value(name, f"tracker_lag_s, {whose}", _LAG_S, found.tracker_lag_s, tolerance=_LAG_TOLERANCE_S)
    apart_px = float(np.nanmedian(np.abs(rows_px - baseline_px)))
    yield Value(name, "median distance of our line from PLUS's, px", float("nan"), apart_px, "report")


def spatial_values(plus: Path) -> Iterator[Value]:
    """Compare the N-wire calibration with both phantoms: the matrix, its corners, its errors.

    Parameters
    ----------
    plus : Path
        Folder of PLUS's test data.

    Yields
    ------
    Value
        One comparison.
    """
    from registration import transforms
    from registration.calibration.spatial import middle_points_mm, phantom_registration
    from registration.readers.plus.config import read_device_set
    from registration.readers.plus.results import read_wire_calibration

    device_set = read_device_set(plus / "PlusDeviceSet_fCal_Sim_SpatialCalibration_2.0.xml")
    newer = read_wire_calibration(plus / _FCAL2)
    yield from _calibration_values(
        _FCAL2, newer, device_set.wires_mm, device_set.transforms.chain("Phantom", "Reference")
    )
    older = read_wire_calibration(plus / _FCAL1)
    wires_mm = np.array([[_hole_mm(name[:2]), _hole_mm(name[2:])] for name in _FCAL1_WIRES])
    assert older.calibration.middle_probe_mm is not None
    reference_T_probe = transforms.invert_rigid(transforms.nearest_rigid(older.calibration.probe_T_reference))
    in_reference = np.concatenate(
        list(map(transforms.apply, reference_T_probe, older.calibration.middle_probe_mm))
    )
    in_phantom = middle_points_mm(older.calibration.points_px, wires_mm).reshape(-1, 3)
    yield from _calibration_values(_FCAL1, older, wires_mm, phantom_registration(in_phantom, in_reference))


def cropped_values(plus: Path) -> Iterator[Value]:
    """Compare where the first pixel of a sequence that PLUS cropped lies, also with the uncropped sequence.

    Parameters
    ----------
    plus : Path
        Folder of PLUS's test data.

    Yields
    ------
    Value
        One comparison.
    """
    from registration import transforms
    from registration.readers.plus.reader import PlusReader
    from registration.synchronisation import synchronise

    wires = "NwirePhantomFreehand"
    reader = PlusReader(device_set=str(plus / f"PlusDeviceSet_{wires}_vtkVolumeReconstructorTest2.xml"))
    first_mm, whole_mm = (
        transforms.apply(
            synchronise(reader(plus / f"{name}.igs.mha"), max_gap_s=1.0).world_A_pixel[0], np.array([pixel])
        )[0]
        for name, pixel in ((f"{wires}Cropped", (0.0, 0.0, 0.0)), (wires, (335.0, 285.0, 0.0)))
    )
    name = f"{wires}Cropped.igs.mha"
    for axis, theirs, ours in zip("xyz", (5.77, -114.93, -36.93), first_mm, strict=True):
        yield Value(name, f"first pixel of frame 0, {axis}_mm", theirs, float(ours), tolerance=0.01)
    apart_mm = float(np.linalg.norm(first_mm - whole_mm))
    yield Value(name, "distance from the same pixel of the whole sequence, mm", 0.01, apart_mm, "below")


def placement_values(plus: Path) -> Iterator[Value]:
    """Compare volumes compounded of frames with PLUS's own reconstructions.

    Parameters
    ----------
    plus : Path
        Folder of PLUS's test data.

    Yields
    ------
    Value
        One comparison.
    """
    spine, wires = "SpinePhantomFreehand", "NwirePhantomFreehand"
    spine_set = "SpinePhantomFreehandReconstructionOnly"
    wires_set, wires_clip = "NwirePhantomFreehand_vtkVolumeReconstructorTest2", ((167, 62), (495, 488))
    yield from _volume_values(plus, spine, spine_set, "SpinePhantomFreehandReconstructed", "linear", "mean")
    # The clip rectangle of this test is not in its device set; it follows from the volume's origin and size.
    late = "vtkVolumeReconstructorTestNNLATEvolumeRef"
    yield from _volume_values(plus, spine, spine_set, late, "nearest", "latest", ((192, 16), (420, 576)))
    yield from _volume_values(plus, wires, wires_set, f"{wires}Reconstructed", "linear", "mean", wires_clip)


ALL: tuple[Callable[[Path], Iterator[Value]], ...] = (
    reading_values,
    cropped_values,
    interpolation_values,
    temporal_values,
    spatial_values,
    placement_values,
)


def table(values: list[Value]) -> pd.DataFrame:
    """Format the comparisons as a table of text.

    Parameters
    ----------
    values : list of Value
        The comparisons.

    Returns
    -------
    DataFrame
        Columns file, quantity, PLUS, ours, met.
    """
    import pandas as pd

    met = {True: "yes", False: "NO", None: "-"}
    rows = [(v.file, v.quantity, v.published_text, f"{v.ours:.6g}", met[v.met]) for v in values]
    return pd.DataFrame(rows, columns=["file", "quantity", "PLUS", "ours", "met"])


def _hole_mm(hole: str) -> list[float]:
    return [
        20.0 + 5 * "EFGHIJK".index(hole[0].upper()),
        0.0 if hole[0].isupper() else 40.0,
        5.0 * (4 - int(hole[1])),
    ]


def _calibration_values(
    file: str, data: WireCalibrationFile, wires_mm: np.ndarray, reference_T_phantom: np.ndarray
) -> Iterator[Value]:
    from registration.calibration.probe import corner_displacement_mm
    from registration.calibration.spatial import (
        NWireCalibration,
        mean_of_best_mm,
        middle_errors_mm,
        middle_points_probe_mm,
    )

    poses = data.calibration.probe_T_reference @ reference_T_phantom
    result = NWireCalibration()(data.calibration.points_px, wires_mm, poses)
    for axis, theirs, ours in zip("xyz", data.probe_A_pixel[:3, 3], result.probe_A_pixel[:3, 3], strict=True):
        yield Value(file, f"translation_{axis}_mm", float(theirs), float(ours), tolerance=0.1)
    corners_mm = corner_displacement_mm(
        result.probe_A_pixel, data.probe_A_pixel, data.height_px, data.width_px
    )
    yield Value(file, "largest displacement of an image corner, mm", 0.1, float(corners_mm.max()), "below")
    target_mm = middle_points_probe_mm(
        data.validation.points_px, wires_mm, data.validation.probe_T_reference @ reference_T_phantom
    )
    validation_mm = middle_errors_mm(result.probe_A_pixel, data.validation.points_px[:, 1::3], target_mm)
    errors = (
        ("calibration", data.calibration_error_mm, result.residuals_mm),
        ("validation", data.validation_error_mm, validation_mm),
    )
    for part, theirs_mm, ours_mm in errors:
        quantity = f"mean 3-D error of the best 95 %, {part}, {len(ours_mm)} frames, mm"
        yield Value(file, quantity, theirs_mm, mean_of_best_mm(ours_mm), tolerance=5e-4)


def _volume_values(
    plus: Path,
    sequence: str,
    device_set: str,
    volume: str,
    interpolation: str,
    compounding: str,
    clip_px: tuple[tuple[int, int], tuple[int, int]] | None = None,
) -> Iterator[Value]:
    from registration.readers.plus.metaimage import read_metaimage
    from registration.readers.plus.reader import PlusReader
    from registration.reconstruction.volume_compounding import VolumeGrid, VolumePlacement, compare
    from registration.synchronisation import synchronise

    sweep = PlusReader(device_set=str(plus / f"PlusDeviceSet_{device_set}.xml"))(plus / f"{sequence}.igs.mha")
    posed = synchronise(sweep, max_gap_s=1.0)
    # A volume is to the reader a stack of slices that needs no turning.
    reference = read_metaimage(plus / f"{volume}.mha", orientation="MF")
    origin_mm = np.array(reference.header["Offset"].split(), dtype=np.float64)
    spacing_mm = float(reference.header["ElementSpacing"].split()[0])
    clip = {} if clip_px is None else {"clip_origin_px": clip_px[0], "clip_size_px": clip_px[1]}
    placement = VolumePlacement(spacing_mm, interpolation, compounding, **clip)
    own = placement.grid(posed.world_A_pixel, *sweep.images.shape[1:])
    shift_mm = float(np.linalg.norm(own.origin_mm - origin_mm))
    theirs = VolumeGrid(origin_mm, spacing_mm, reference.pixels.shape[::-1])
    yield Value(f"{volume}.mha", "distance of the origins, mm", 0.01, shift_mm, "below")
    # Versions of PLUS differ in whether they count the last voxel.
    misfit = int(np.abs(np.array(own.size) - theirs.size).max())
    yield Value(f"{volume}.mha", "largest difference in size, voxels", 0, misfit, tolerance=1)
    agreement = compare(placement(sweep.images, posed.world_A_pixel, theirs), reference.pixels)
    reported = {
        "share of PLUS's voxels also filled": agreement.reference_covered,
        "correlation of the grey values in both": agreement.correlation,
        "mean absolute difference, grey levels": agreement.difference_mean,
        "share equal within one grey level": agreement.same_share,
    }
    for quantity, ours in reported.items():
        yield Value(f"{volume}.mha", quantity, float("nan"), ours, "report")
