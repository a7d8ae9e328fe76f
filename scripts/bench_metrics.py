"""How long the boundary distances take next to their peers, on 512x512 vessel masks, and how far they differ."""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable

import numpy as np
import surface_distance
import torch
from monai.metrics import compute_hausdorff_distance
from quick_budget import parsed

from models.metrics.masks import hd95_mm, hd95_surfel_mm

SPACING_MM = (0.11, 0.09)


def vessel(centre: tuple[float, float], radii: tuple[float, float], lobes: float) -> np.ndarray:
    """An ellipse with a wavy wall, of the size a vessel has in a frame."""
    row, column = np.mgrid[:512, :512]
    angle = np.arctan2(row - centre[0], column - centre[1])
    radius = ((row - centre[0]) / radii[0]) ** 2 + ((column - centre[1]) / radii[1]) ** 2
    return radius < 1 + 0.15 * np.sin(5 * angle + lobes)


def monai_hd95(prediction: np.ndarray, reference: np.ndarray) -> float:
    """MONAI's percentile Hausdorff distance, the larger of both directions."""
    tensors = (torch.from_numpy(mask)[None, None] for mask in (prediction, reference))
    return float(
        compute_hausdorff_distance(*tensors, include_background=True, percentile=95, spacing=list(SPACING_MM))
    )


def surfel_hd95(prediction: np.ndarray, reference: np.ndarray) -> float:
    """The robust Hausdorff distance of surface-distance."""
    distances = surface_distance.compute_surface_distances(reference, prediction, SPACING_MM)
    return float(surface_distance.compute_robust_hausdorff(distances, 95))


def median_ms(call: Callable[[], float], repeats: int) -> float:
    """Median wall time over the repeats, after one call to warm up."""
    call()
    times_s = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times_s.append(time.perf_counter() - start)
    return 1000 * float(np.median(times_s))


def main() -> None:
    """Print one line for each metric and mask."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=20)
    repeats = parsed(parser, {"repeats": 2}).repeats
    warnings.filterwarnings("ignore")
    torch.set_num_threads(1)  # small masks gain nothing from more, and busy neighbours cost the peers dearly
    pairs = {
        "small vessel": (vessel((150, 300), (25, 35), 0.0), vessel((155, 296), (28, 33), 1.0)),
        "large vessel": (vessel((250, 260), (120, 150), 0.0), vessel((258, 255), (125, 140), 1.0)),
        "far miss": (vessel((100, 90), (40, 40), 0.0), vessel((400, 420), (60, 50), 1.0)),
    }
    print(f"{'masks':14s}{'metric':16s}{'ours_ms':>9s}{'peer_ms':>9s}{'ratio':>7s}{'difference_mm':>15s}")
    for name, (prediction, reference) in pairs.items():
        for metric, ours, peer in (
            ("hd95_mm", hd95_mm, monai_hd95),
            ("hd95_surfel_mm", hd95_surfel_mm, surfel_hd95),
        ):
            difference = abs(ours(prediction, reference, SPACING_MM) - peer(prediction, reference))
            own_ms = median_ms(lambda f=ours, p=prediction, r=reference: f(p, r, SPACING_MM), repeats)
            peer_ms = median_ms(lambda f=peer, p=prediction, r=reference: f(p, r), repeats)
            print(
                f"{name:14s}{metric:16s}{own_ms:9.2f}{peer_ms:9.2f}{peer_ms / own_ms:7.1f}{difference:15.1e}"
            )


if __name__ == "__main__":
    main()
