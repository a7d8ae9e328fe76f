"""What is known of the right pose of two files: the measured error that stands beside the predicted one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from experiments.analysis.registration.simulated_truth import read_targets
from experiments.inputs.surfaces import read_pose
from registration.metrics.surface_distance import pose_error


@dataclass(frozen=True)
class KnownTruth:
    """The right pose of the moving file.

    Parameters
    ----------
    path : Path
        File that it was read from.
    fixed_T_moving : ndarray, shape (4, 4)
        Rigid transform from the moving to the fixed frame, in mm.
    targets_mm : ndarray, shape (t, 3), or None
        Targets in the fixed frame in mm, where the file names some.
    """

    path: Path
    fixed_T_moving: Float64[np.ndarray, "4 4"]
    targets_mm: Float64[np.ndarray, "t 3"] | None

    def tre_mm(
        self, fixed_T_moving: Float64[np.ndarray, "4 4"], targets_mm: Float64[np.ndarray, "t 3"]
    ) -> float:
        """Measure the target registration error of a pose.

        Parameters
        ----------
        fixed_T_moving : ndarray, shape (4, 4)
            Pose.
        targets_mm : ndarray, shape (t, 3)
            Targets in the fixed frame in mm.

        Returns
        -------
        float
            Root mean square error in mm.
        """
        return float(pose_error(fixed_T_moving, self.fixed_T_moving, targets_mm).tre_mm)


def read_known_truth(truth: str | None) -> KnownTruth | None:
    """Read the right pose of a pair of files.

    Parameters
    ----------
    truth : str or None
        File of the pose, as ``initial`` has it; ``truth.json`` of a simulated sweep names its targets too. None where
        nothing is known.

    Returns
    -------
    KnownTruth or None
        The pose and its targets; None for None.

    Raises
    ------
    InputError
        If the file cannot be read or holds no pose.
    """
    if truth is None:
        return None
    path = Path(truth)
    pose, targets = read_pose(path, "truth"), read_targets(path, "truth")
    return KnownTruth(path, pose, None if targets is None else targets[0])
