"""What of a registration of two files goes into its scene for 3D Slicer."""

from __future__ import annotations

from experiments.analysis.registration.slicer_result import SlicerResult
from experiments.studies.register.carried import CENTERLINES, carried_record
from experiments.studies.register.record import Registered
from registration import transforms
from registration.io.landmarks import Landmarks


def slicer_result(found: Registered) -> SlicerResult:
    """Collect surfaces, centerlines, landmarks and what deformed, all in the fixed frame.

    Parameters
    ----------
    found : Registered
        Registered pair.

    Returns
    -------
    SlicerResult
        What the scene shows.
    """
    pair, pose = found.pair, found.result.fixed_T_moving
    lines = {}
    if pair.fixed.centerline is not None:
        lines["centerline, fixed"] = pair.fixed.centerline
    if pair.moving.centerline is not None:
        lines["centerline, moved"] = pair.moving.centerline.transformed(pose)
    landmarks = {}
    if pair.landmarks is not None:
        names = pair.landmarks.names
        landmarks["landmarks, fixed"] = Landmarks(names, pair.landmarks.fixed_mm)
        landmarks["landmarks, moved"] = Landmarks(names, transforms.apply(pose, pair.landmarks.moving_mm))
    carried: tuple[str, ...] = ()
    if found.deformed is not None:
        written = carried_record(found.carried, found.deformed, pair, pose)["carried"]
        # The table of a centerline says what its lines say, and Slicer reads no centerline from a table.
        carried = tuple(name for name in written if name != CENTERLINES[1])
    return SlicerResult(
        pair.fixed.surface,
        pair.moving.surface,
        pose,
        lines,
        landmarks,
        deformed=found.deformed,
        carried=carried,
    )
