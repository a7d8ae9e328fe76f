"""Study ``calibrate_spatial``: where the image lies on the probe, from an N-wire phantom."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments import files
from experiments.errors import InputError
from experiments.inputs.paths import require_exists
from experiments.outcome import Outcome, Progress
from experiments.paths import PathSetting
from experiments.reporting.labels import axis_label

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from registration.calibration.spatial import NWireCalibration
    from registration.readers.plus.config import DeviceSet
    from registration.readers.plus.results import WireCalibrationFile, WireFrames


def check(*, results: PathSetting, device_set: PathSetting) -> None:
    """Check that both files exist.

    Parameters
    ----------
    results : PathSetting
        File of segmented points and poses (PLUS ``.results.xml``).
    device_set : PathSetting
        Device-set XML file with the wires.

    Raises
    ------
    InputError
        If a file does not exist.
    """
    require_exists(results, "results")
    require_exists(device_set, "device_set")


def run(
    *,
    results: PathSetting,
    device_set: PathSetting,
    probe: str,
    reference: str,
    phantom_frame: str,
    best_share: float,
    spatial: NWireCalibration,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Calibrate a probe and leave ``probe.yaml`` and a device set ``probe.xml`` in ``workspace``.

    Parameters
    ----------
    results : PathSetting
        File of segmented points and poses (PLUS ``.results.xml``).
    device_set : PathSetting
        Device-set XML file with the wires and, optionally, the registration of the phantom.
    probe, reference, phantom_frame : str
        Name of the coordinate frame in the files.
    best_share : float
        Share of the points, the best ones, over which mean errors are taken.
    spatial : NWireCalibration
        Calibration method.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each middle point, the figure of residuals, and findings.

    Raises
    ------
    InputError
        If a file does not exist or the device set has no wires.
    """
    from registration.readers.chain.graph import TransformGraph
    from registration.readers.plus.calibration_file import calibration_yaml
    from registration.readers.plus.config import device_set_xml, read_device_set
    from registration.readers.plus.results import read_wire_calibration
    from registration.sweep import ProbeCalibration

    data = read_wire_calibration(require_exists(results, "results"), probe, reference)
    defined = read_device_set(require_exists(device_set, "device_set"))
    if not len(defined.wires_mm):
        raise InputError(f"device_set: expected NWire patterns in {device_set}, found none")
    registered, how = _registration(defined, data, phantom_frame, reference)
    poses = data.calibration.probe_T_reference @ registered
    progress.note(f"calibrating from {len(poses)} frames")
    result = spatial(data.calibration.points_px, defined.wires_mm, poses)
    matrix = result.probe_A_pixel
    cases = _cases(data, defined, registered, matrix, result.outliers)
    files.write_text(workspace / "probe.yaml", calibration_yaml(ProbeCalibration(np.eye(4), matrix)))
    files.write_text(workspace / "probe.xml", device_set_xml(TransformGraph({("Image", probe): matrix})))
    metrics = _metrics(data, cases, matrix, best_share)
    return Outcome(
        metrics=metrics,
        cases=cases,
        figures={"residuals": _figure(cases)},
        findings=_findings(metrics, data, best_share, how),
    )


def _findings(
    metrics: dict[str, float], data: WireCalibrationFile, best_share: float, how: str
) -> tuple[str, ...]:
    """The errors in one sentence, the image's geometry in another."""
    return (
        f"Mean 3-D error over the best {best_share:.0%} of the points: {metrics['error_calibration_mm']:.3f} mm "
        f"on {len(data.calibration.points_px)} calibration frames, {metrics['error_validation_mm']:.3f} mm on "
        f"{len(data.validation.points_px)} validation frames; phantom registered {how}.",
        f"Pixels of {metrics['column_mm']:.4f} by {metrics['row_mm']:.4f} mm, sheared by "
        f"{metrics['shear_deg']:.2f} degrees; image corners at most "
        f"{metrics['corner_displacement_max_mm']:.4f} mm from the calibration in the file.",
    )


def _metrics(
    data: WireCalibrationFile, cases: pd.DataFrame, matrix: np.ndarray, best_share: float
) -> dict[str, float]:
    """Errors of both parts, the pixels' geometry, and how far the image's corners lie from the file's calibration."""
    from registration.calibration.probe import corner_displacement_mm, pixel_geometry
    from registration.calibration.spatial import mean_of_best_mm

    errors = {part: group["error_mm"].to_numpy() for part, group in cases.groupby("part")}
    geometry = pixel_geometry(matrix)
    displaced_mm = corner_displacement_mm(matrix, data.probe_A_pixel, data.height_px, data.width_px)
    return {
        "error_calibration_mm": mean_of_best_mm(errors["calibration"], best_share),
        "error_validation_mm": mean_of_best_mm(errors["validation"], best_share),
        "column_mm": geometry.column_mm,
        "row_mm": geometry.row_mm,
        "shear_deg": geometry.shear_deg,
        "outliers": float(cases["outlier"].sum()),
        "corner_displacement_max_mm": float(displaced_mm.max()),
    }


def _registration(
    device_set: DeviceSet, data: WireCalibrationFile, phantom_frame: str, reference: str
) -> tuple[np.ndarray, str]:
    """``reference_T_phantom`` from the device set, or, where that has none, from the middle points in the results."""
    import registration.errors
    from registration import transforms
    from registration.calibration.spatial import middle_points_mm, phantom_registration

    try:
        registered = device_set.transforms.chain(phantom_frame, reference)
        return transforms.nearest_rigid(
            transforms.require_rigid(registered, f"{phantom_frame}To{reference}")
        ), "as defined"
    except registration.errors.InputError:
        if (
            data.calibration.middle_probe_mm is None
            or (phantom_frame, reference) in device_set.transforms.edges
        ):
            raise
    in_phantom = middle_points_mm(data.calibration.points_px, device_set.wires_mm).reshape(-1, 3)
    reference_T_probe = transforms.invert_rigid(transforms.nearest_rigid(data.calibration.probe_T_reference))
    in_reference = np.concatenate(
        list(map(transforms.apply, reference_T_probe, data.calibration.middle_probe_mm))
    )
    return phantom_registration(in_phantom, in_reference), "to the middle points that the results hold"


def _cases(
    data: WireCalibrationFile,
    device_set: DeviceSet,
    registered: np.ndarray,
    matrix: np.ndarray,
    outliers: np.ndarray,
) -> pd.DataFrame:
    """A row for each middle point of either part: its pixel and its error."""
    import pandas as pd

    from registration.calibration.spatial import middle_errors_mm, middle_points_probe_mm

    tables = []
    parts: dict[str, WireFrames] = {"calibration": data.calibration, "validation": data.validation}
    for part, found in parts.items():
        target = middle_points_probe_mm(
            found.points_px, device_set.wires_mm, found.probe_T_reference @ registered
        )
        middle_px = found.points_px[:, 1::3]
        frame, pattern = np.indices(middle_px.shape[:2])
        tables.append(
            pd.DataFrame(
                {
                    "part": part,
                    "frame": frame.reshape(-1),
                    "wire": [device_set.wire_names[3 * index + 1] for index in pattern.reshape(-1)],
                    "column_px": middle_px[..., 0].reshape(-1),
                    "row_px": middle_px[..., 1].reshape(-1),
                    "error_mm": middle_errors_mm(matrix, middle_px, target).reshape(-1),
                    "outlier": outliers.reshape(-1) if part == "calibration" else False,
                }
            )
        )
    return pd.concat(tables, ignore_index=True)


def _figure(cases: pd.DataFrame) -> Figure:
    """Errors over the image, and their distribution in both parts."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.5), layout="constrained")
    image, spread = figure.subplots(1, 2)
    drawn = image.scatter(cases["column_px"], cases["row_px"], c=cases["error_mm"], s=8, cmap="viridis")
    image.set(xlabel=axis_label("column_px"), ylabel=axis_label("row_px"), aspect="equal")
    image.invert_yaxis()
    figure.colorbar(drawn, ax=image, label=axis_label("error_mm"))
    bins = np.linspace(0, float(cases["error_mm"].max()), 40).tolist()
    for part, group in cases.groupby("part"):
        spread.hist(group["error_mm"], bins=bins, alpha=0.6, label=axis_label(str(part)), density=True)
    spread.set(xlabel=axis_label("error_mm"), ylabel="Density (1/mm)")
    spread.legend()
    return figure
