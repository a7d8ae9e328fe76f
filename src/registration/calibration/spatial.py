"""Probe calibration from images of an N-wire phantom.

Where the slanted middle wire of an N cuts the image between its two parallel neighbours says where along the wire
that was: the ratio of the distances in the image is the ratio in the phantom (Chen et al., Ultrasound Med. Biol.
35(10), 2009). The middle points, carried to the probe by the tracker, and their pixels give the affine calibration
by linear least squares with rejection of outliers (Carbajal et al., Int. J. CARS 8(6), 2013).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from registration import transforms
from registration.brief import brief_repr
from registration.calibration.probe import complete_right_handed
from registration.checks import require_count, require_positive
from registration.errors import InputError
from registration.geometry.rigid_fit import kabsch


@dataclass(frozen=True)
class NWireResult:
    """Probe calibration from an N-wire phantom.

    Parameters
    ----------
    probe_A_pixel : ndarray, shape (4, 4)
        Affine matrix from pixels to the probe frame in mm; its third column makes it right-handed.
    residuals_mm : ndarray, shape (k, p)
        Residual in mm of every middle point (k frames, p patterns), used or not.
    outliers : ndarray of bool, shape (k, p)
        Middle points that were left out.
    """

    probe_A_pixel: Float64[np.ndarray, "4 4"]
    residuals_mm: Float64[np.ndarray, "k p"]
    outliers: Bool[np.ndarray, "k p"]

    __repr__ = brief_repr


@dataclass(frozen=True)
class NWireCalibration:
    """Least-squares calibration from N-wire fiducials with rejection of outliers.

    For each coordinate separately, equations whose residual deviates too much from the mean are left out and
    the fit is repeated until none does.

    Parameters
    ----------
    outlier_sigma : float, optional
        Number of standard deviations from which a residual is an outlier.
    min_frames : int, optional
        Smallest number of frames, at least 2.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    outlier_sigma: float = 3.0
    min_frames: int = 10

    def __post_init__(self) -> None:
        require_positive("outlier_sigma", self.outlier_sigma)
        require_count("min_frames", self.min_frames, 2)

    def __call__(
        self,
        points_px: Float64[np.ndarray, "k w 2"],
        wires_mm: Float64[np.ndarray, "_ 2 3"],
        probe_T_phantom: Float64[np.ndarray, "k 4 4"],
    ) -> NWireResult:
        """Calibrate from the pixels of all wires.

        Parameters
        ----------
        points_px : ndarray, shape (k, w, 2)
            Pixel (column, row) of each wire in each of k frames, three wires a pattern.
        wires_mm : ndarray, shape (w, 2, 3)
            Ends of each wire in the phantom frame in mm.
        probe_T_phantom : ndarray, shape (k, 4, 4)
            Pose of the phantom in each frame.

        Returns
        -------
        NWireResult
            The calibration, residuals and outliers.

        Raises
        ------
        InputError
            If there are too few frames, or points on a line, which leave the calibration undetermined.
        """
        if len(points_px) < self.min_frames:
            raise InputError(
                f"points_px: expected at least {self.min_frames} frames, received {len(points_px)}"
            )
        middle_px = points_px[:, 1::3]
        target_mm = middle_points_probe_mm(points_px, wires_mm, probe_T_phantom)
        equations = np.concatenate([middle_px.reshape(-1, 2), np.ones((middle_px[..., 0].size, 1))], axis=1)
        spread_px = np.linalg.svd(equations[:, :2] - equations[:, :2].mean(axis=0), compute_uv=False)
        if spread_px[1] < 1e-6 * max(spread_px[0], 1.0):
            raise InputError(
                "points_px: expected middle wires that span the image plane, received points on a line"
            )
        fits = [self._fit(equations, coordinate) for coordinate in target_mm.reshape(-1, 3).T]
        column_mm, row_mm, origin_mm = np.stack([solution for solution, _ in fits], axis=1)
        used = np.logical_and.reduce([kept for _, kept in fits]).reshape(middle_px.shape[:2])
        probe_A_pixel = complete_right_handed(column_mm, row_mm, origin_mm)
        return NWireResult(probe_A_pixel, middle_errors_mm(probe_A_pixel, middle_px, target_mm), ~used)

    def _fit(self, equations: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solve for one coordinate; the solution, and which equations it rests on."""
        kept = np.ones(len(target), dtype=bool)
        while True:
            solution = np.linalg.lstsq(equations[kept], target[kept], rcond=None)[0]
            residual = equations @ solution - target
            mean, deviation = residual[kept].mean(), residual[kept].std()
            # Data without noise leave residuals of rounding only, none of which is an outlier.
            limit = max(self.outlier_sigma * deviation, 1e-9)
            still = kept & (np.abs(residual - mean) < limit)
            if still.sum() < 2 * equations.shape[1]:
                raise InputError(
                    f"points_px: expected at least {2 * equations.shape[1]} points that agree, received {still.sum()}"
                )
            if (still == kept).all():
                return solution, kept
            kept = still


def middle_points_mm(
    points_px: Float64[np.ndarray, "k w 2"], wires_mm: Float64[np.ndarray, "_ 2 3"]
) -> Float64[np.ndarray, "k p 3"]:
    """Compute where the middle wires cut the image, from the ratios of distances in the image.

    Parameters
    ----------
    points_px : ndarray, shape (k, w, 2)
        Pixel (column, row) of each wire in each of k frames, three wires a pattern.
    wires_mm : ndarray, shape (w, 2, 3)
        Ends of each wire in the phantom frame in mm.

    Returns
    -------
    ndarray, shape (k, p, 3)
        Middle point of each pattern in the phantom frame in mm.

    Raises
    ------
    InputError
        If the numbers of points and wires disagree, outer wires fall on one pixel, or wires are parallel.
    """
    if len(wires_mm) == 0 or len(wires_mm) % 3 or points_px.shape[1] != len(wires_mm):
        raise InputError(
            f"points_px: expected a point for each of {len(wires_mm)} wires, three a pattern, "
            f"received {points_px.shape[1]}"
        )
    first, middle, last = points_px[:, 0::3], points_px[:, 1::3], points_px[:, 2::3]
    span_px = np.linalg.norm(last - first, axis=2)
    if not (span_px > 0).all():
        raise InputError(
            "points_px: expected the outer wires of a pattern apart, received the same pixel for both"
        )
    ratio = (np.linalg.norm(middle - first, axis=2) / span_px)[..., None]
    start = np.stack([_crossing_mm(wires_mm[at + 1], wires_mm[at]) for at in range(0, len(wires_mm), 3)])
    end = np.stack([_crossing_mm(wires_mm[at + 1], wires_mm[at + 2]) for at in range(0, len(wires_mm), 3)])
    return start + ratio * (end - start)


def middle_points_probe_mm(
    points_px: Float64[np.ndarray, "k w 2"],
    wires_mm: Float64[np.ndarray, "_ 2 3"],
    probe_T_phantom: Float64[np.ndarray, "k 4 4"],
) -> Float64[np.ndarray, "k p 3"]:
    """Compute the middle points in the probe frame.

    Parameters
    ----------
    points_px : ndarray, shape (k, w, 2)
        Pixel (column, row) of each wire in each of k frames, three wires a pattern.
    wires_mm : ndarray, shape (w, 2, 3)
        Ends of each wire in the phantom frame in mm.
    probe_T_phantom : ndarray, shape (k, 4, 4)
        Pose of the phantom in each frame.

    Returns
    -------
    ndarray, shape (k, p, 3)
        Middle point of each pattern in the probe frame in mm.
    """
    in_phantom = middle_points_mm(points_px, wires_mm)
    return in_phantom @ np.swapaxes(probe_T_phantom[:, :3, :3], 1, 2) + probe_T_phantom[:, None, :3, 3]


def middle_errors_mm(
    probe_A_pixel: Float64[np.ndarray, "4 4"],
    middle_px: Float64[np.ndarray, "k p 2"],
    target_mm: Float64[np.ndarray, "k p 3"],
) -> Float64[np.ndarray, "k p"]:
    """Measure the distances between the middle points by the calibration and by the tracker.

    Parameters
    ----------
    probe_A_pixel : ndarray, shape (4, 4)
        Calibration.
    middle_px : ndarray, shape (k, p, 2)
        Pixel (column, row) of each middle wire.
    target_mm : ndarray, shape (k, p, 3)
        The same points by the tracker, in the probe frame in mm.

    Returns
    -------
    ndarray, shape (k, p)
        Distances in mm.
    """
    pixels = np.concatenate([middle_px, np.zeros_like(middle_px[..., :1])], axis=2)
    return np.linalg.norm(transforms.apply(probe_A_pixel, pixels) - target_mm, axis=2)


def mean_of_best_mm(errors_mm: Float64[np.ndarray, " *n"], share: float = 0.95) -> float:
    """Average the smallest share of the errors, as PLUS reports calibrations.

    Parameters
    ----------
    errors_mm : ndarray, shape (...,)
        Errors in mm.
    share : float, optional
        Share of the errors, above 0 to 1.

    Returns
    -------
    float
        Mean in mm.

    Raises
    ------
    InputError
        If there is no error or the share is out of range.
    """
    require_positive("share", share, 1)
    ordered = np.sort(errors_mm, axis=None)
    if not len(ordered):
        raise InputError("errors_mm: expected at least one error, received none")
    return float(ordered[: max(1, round(share * len(ordered)))].mean())


def phantom_registration(
    phantom_mm: Float64[np.ndarray, "n 3"], reference_mm: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "4 4"]:
    """Register a phantom from the same points in both frames.

    Parameters
    ----------
    phantom_mm : ndarray, shape (n, 3)
        Points in the phantom frame in mm, at least three.
    reference_mm : ndarray, shape (n, 3)
        The same points in the reference frame in mm.

    Returns
    -------
    ndarray, shape (4, 4)
        ``reference_T_phantom``.

    Raises
    ------
    InputError
        If there are fewer than three points or they lie on a line.
    """
    centred_mm = phantom_mm - phantom_mm.mean(axis=0), reference_mm - reference_mm.mean(axis=0)
    spread = np.linalg.svd(centred_mm[0].T @ centred_mm[1], compute_uv=False)
    if len(phantom_mm) < 3 or spread[1] < 1e-9 * spread[0]:
        raise InputError("phantom_mm: expected at least three points not on a line, received fewer")
    return kabsch(phantom_mm, reference_mm)


def _crossing_mm(wire_mm: Float64[np.ndarray, "2 3"], other_mm: Float64[np.ndarray, "2 3"]) -> np.ndarray:
    """The point of a wire, as an endless line, that is nearest to another: where an N's strokes meet."""
    along, across = wire_mm[1] - wire_mm[0], other_mm[1] - other_mm[0]
    if np.linalg.norm(np.cross(along, across)) < 1e-9 * np.linalg.norm(along) * np.linalg.norm(across):
        raise InputError("wires_mm: expected middle wires aslant to their neighbours, received parallel ones")
    solution = np.linalg.lstsq(np.stack([along, -across], axis=1), other_mm[0] - wire_mm[0], rcond=None)[0]
    return wire_mm[0] + solution[0] * along
