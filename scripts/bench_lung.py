"""How far landmarks in lungs are off after large breathing motion: the displacement search, and a drift as its peer.

    python scripts/bench_lung.py [FOLDER] [--cases 5] [--no-peer] [--quick]

FOLDER holds the public lungs. A random 70 % of the points at inspiration move onto another random 70 % at expiration,
both shuffled, so that about half of all points recur in both clouds. The error is the mean distance of the carried
landmarks, which experts set. The stages of the search were set on cases 104 and 108: the figures of 106, 110 and 112
are the judged ones, and have a mean of their own. The peer is Coherent Point Drift by rustcpd, from the affine start.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from quick_budget import data_folder, parsed

from registration.deformable.displacement_search import DisplacementSearch, moment_matched_affine
from registration.deformable.point_drift import PointResiduals, drift_points

CASES, JUDGED = (104, 106, 108, 110, 112), (106, 110, 112)
KEPT_SHARE = 0.7
# A rank of 300 with a kernel of 20 mm is too coarse for a lung: it left more than the affine start does.
PEER = PointResiduals(beta_mm=30.0, roughness_per_mm2=0.1, neighbours=None, rank=800)
COLUMNS = ("raw", "affine", "peer", "peer s", "search", "search s")


@dataclass(frozen=True)
class LungCase:
    """Two clouds of one lung and its landmarks, all in mm and in one frame."""

    moving_mm: np.ndarray
    fixed_mm: np.ndarray
    moving_landmarks_mm: np.ndarray
    fixed_landmarks_mm: np.ndarray

    def error_mm(self, moved_mm: np.ndarray) -> float:
        """Mean distance of the carried landmarks from the fixed ones."""
        return float(np.linalg.norm(moved_mm - self.fixed_landmarks_mm, axis=1).mean())


def main() -> None:
    """Print a line for each case, and lines of means."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--cases", type=int, default=len(CASES), help="the first so many of the five")
    parser.add_argument(
        "--no-peer", action="store_true", help="leave the drift out, which takes most of the time"
    )
    given = parsed(parser, {"cases": 1})
    folder = data_folder(given.folder, "lung")
    if folder is None:
        return
    print("mean landmark error (mm) and time (s); the peer is rustcpd from the affine start")
    print(f"{'case':>14s}" + "".join(f"{name:>10s}" for name in COLUMNS))
    rows = {}
    for number in CASES[: given.cases]:
        rows[number] = measured(read_case(folder, number), peer=not given.no_peer)
        print_row(str(number), rows[number])
    for name, numbers in (("mean of judged", JUDGED), ("mean of all", CASES)):
        chosen = [rows[number] for number in numbers if number in rows]
        if chosen:
            print_row(name, np.mean(chosen, axis=0))


def read_case(folder: Path, number: int) -> LungCase:
    """A case with its points drawn: the number is the seed."""
    points_mm, landmarks_mm = (
        np.loadtxt(folder / f"case_{number}_{name}.csv", delimiter=",", skiprows=1)
        for name in ("keypoints", "landmarks")
    )
    rng = np.random.default_rng(number)
    kept = round(KEPT_SHARE * len(points_mm))
    moving, fixed = (rng.permutation(len(points_mm))[:kept] for _ in range(2))
    return LungCase(points_mm[moving, :3], points_mm[fixed, 3:6], landmarks_mm[:, :3], landmarks_mm[:, 3:6])


def measured(case: LungCase, peer: bool) -> np.ndarray:
    """What the columns say of a case; NaN for the peer where that is left out."""
    landmarks_mm = case.moving_landmarks_mm
    matrix, offset_mm = moment_matched_affine(case.moving_mm, case.fixed_mm)
    affine_mm = landmarks_mm @ matrix + offset_mm
    peer_mm = peer_s = np.nan
    if peer:
        begin_s = time.perf_counter()
        drifted = drift_points(case.moving_mm @ matrix + offset_mm, case.fixed_mm, PEER)
        peer_s = time.perf_counter() - begin_s
        peer_mm = case.error_mm(affine_mm + drifted.field(affine_mm))
    begin_s = time.perf_counter()
    displacement = DisplacementSearch()(case.moving_mm, case.fixed_mm)
    search_s = time.perf_counter() - begin_s
    search_mm = case.error_mm(landmarks_mm + displacement(landmarks_mm))
    raw_mm = case.error_mm(landmarks_mm)
    return np.array([raw_mm, case.error_mm(affine_mm), peer_mm, peer_s, search_mm, search_s])


def print_row(name: str, row: np.ndarray) -> None:
    """Print one line of the table."""
    print(
        f"{name:>14s}" + "".join("         -" if np.isnan(value) else f"{value:10.2f}" for value in row),
        flush=True,
    )


if __name__ == "__main__":
    main()
