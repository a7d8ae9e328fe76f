"""What PLUS's calibrations leave behind: segmented wires with poses, and lines of a water tank's bottom."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration.errors import InputError
from registration.input_files import LARGEST_TEXT_BYTES, guarded
from registration.readers.chain.graph import TransformGraph
from registration.readers.chain.names import resolve
from registration.readers.plus.config import numbers, parse_xml


@dataclass(frozen=True)
class WireFrames:
    """Frames with segmented wires.

    Parameters
    ----------
    points_px : ndarray, shape (k, w, 2)
        Wires' points as (column, row) in px.
    probe_T_reference : ndarray, shape (k, 4, 4)
        Rigid transforms by the tracker, in mm.
    middle_probe_mm : ndarray, shape (k, p, 3), or None
        Middle points in the probe's coordinate frame that PLUS computed; None where it recorded none.
    failed : int
        Number of frames without segmentation.
    """

    points_px: Float64[np.ndarray, "k w 2"]
    probe_T_reference: Float64[np.ndarray, "k 4 4"]
    middle_probe_mm: Float64[np.ndarray, "k p 3"] | None
    failed: int


@dataclass(frozen=True)
class WireCalibrationFile:
    """A ``.results.xml`` of PLUS's probe calibration: its data, and the result and errors that PLUS found.

    Parameters
    ----------
    calibration : WireFrames
        Frames of the calibration.
    validation : WireFrames
        Frames of the validation.
    probe_A_pixel : ndarray, shape (4, 4)
        Result of PLUS, from pixels to mm in the probe's coordinate frame.
    calibration_error_mm : float
        Mean error that PLUS reports for the calibration.
    validation_error_mm : float
        Mean error that PLUS reports for the validation.
    height_px : int
        Height of the frames.
    width_px : int
        Width of the frames.
    """

    calibration: WireFrames
    validation: WireFrames
    probe_A_pixel: Float64[np.ndarray, "4 4"]
    calibration_error_mm: float
    validation_error_mm: float
    height_px: int
    width_px: int


@guarded("results of a calibration", LARGEST_TEXT_BYTES)
def read_wire_calibration(
    path: Path, probe: str = "Probe", reference: str = "Reference"
) -> WireCalibrationFile:
    """Read the results of an N-wire calibration.

    Parameters
    ----------
    path : Path
        File ending in ``.results.xml``.
    probe : str, optional
        PLUS's name of the probe.
    reference : str, optional
        PLUS's name of the reference; poses are the chain from it to the probe.

    Returns
    -------
    WireCalibrationFile
        Data, result and errors.

    Raises
    ------
    InputError
        If the file is not what it must be.
    """
    root = parse_xml(path)
    result, report = root.find("CalibrationResults/Transform"), root.find("ErrorReport")
    statistics = root.find("ErrorReport/ReprojectionError3DStatistics")
    if root.tag != "ProbeCalibrationResult" or result is None or report is None or statistics is None:
        raise InputError(
            f"{path}: expected a ProbeCalibrationResult with result and errors, found {root.tag}"
        )
    tracked = next(root.iter("TrackedFrame"), None)
    size = np.zeros(2) if tracked is None else numbers(tracked, "FrameSize", 2, path)
    return WireCalibrationFile(
        calibration=_wire_frames(report.find("CalibrationData"), probe, reference, path),
        validation=_wire_frames(report.find("ValidationData"), probe, reference, path),
        probe_A_pixel=numbers(result, "Matrix", 16, path).reshape(4, 4),
        calibration_error_mm=float(numbers(statistics, "CalibrationMeanMm", 1, path)[0]),
        validation_error_mm=float(numbers(statistics, "ValidationMeanMm", 1, path)[0]),
        height_px=int(size[1]),
        width_px=int(size[0]),
    )


@guarded("line positions of PLUS", LARGEST_TEXT_BYTES)
def read_line_rows_px(path: Path, column_px: float) -> Float64[np.ndarray, " n"]:
    """Read the rows of the lines in a file of PLUS's line segmentation at one column.

    Parameters
    ----------
    path : Path
        XML file.
    column_px : float
        Column in px.

    Returns
    -------
    ndarray, shape (n,)
        Row of each frame's line in px, NaN where PLUS found none.

    Raises
    ------
    InputError
        If the file is not what it must be.
    """
    rows = []
    for node in parse_xml(path).findall("Frame"):
        if node.get("SegmentationStatus") != "OK":
            rows.append(float("nan"))
            continue
        origin = numbers(node, "LineOriginPointPx", 2, path)
        along = numbers(node, "LineDirectionVectorPx", 2, path)
        rows.append(float(origin[1] + (column_px - origin[0]) / along[0] * along[1]))
    if not rows:
        raise InputError(f"{path}: expected frames with line positions, found none")
    return np.array(rows, dtype=np.float64)


def _wire_frames(data: ElementTree.Element | None, probe: str, reference: str, path: Path) -> WireFrames:
    nodes = [] if data is None else data.findall("Frame")
    segmented = [node for node in nodes if node.get("SegmentationStatus") == "OK"]
    if not segmented:
        raise InputError(f"{path}: expected frames with segmented wires, found none")
    points = [
        [numbers(point, "Position", 3, path)[:2] for point in node.findall("SegmentedPoints/Point")]
        for node in segmented
    ]
    if len({len(frame) for frame in points}) != 1:
        raise InputError(f"{path}: expected the same number of wires in every frame, found different ones")
    middle = [
        [
            numbers(wire, "PositionInProbeFrame", 4, path)[:3]
            for wire in node.findall("MiddleWires/MiddleWire")
        ]
        for node in segmented
    ]
    return WireFrames(
        points_px=np.array(points, dtype=np.float64),
        probe_T_reference=np.stack([_pose(node, probe, reference, path) for node in segmented]),
        middle_probe_mm=np.array(middle, dtype=np.float64) if all(middle) else None,
        failed=len(nodes) - len(segmented),
    )


def _pose(node: ElementTree.Element, probe: str, reference: str, path: Path) -> Float64[np.ndarray, "4 4"]:
    """The chain from reference to probe through the transforms that the frame was recorded with."""
    fields = {str(field.get("Name")): field for field in node.findall("TrackedFrame/CustomFrameField")}
    edges: dict[tuple[str, str], np.ndarray] = {}
    names = [name.removesuffix("Transform") for name in fields if name.endswith("Transform")]
    for name, pair in resolve(names, (probe, reference)).items():
        status = fields.get(f"{name}TransformStatus")
        if status is None or status.get("Value") == "OK":
            edges[pair] = numbers(fields[f"{name}Transform"], "Value", 16, path).reshape(4, 4)
    try:
        return TransformGraph(edges).chain(reference, probe)
    except InputError as failure:
        raise InputError(f"{path}: frame {node.get('Index')}: {failure}") from failure
