"""What is claimed of the speed of networks and their measures, each with its peers."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from monai_training import in_monai
from side_by_side import Claim, Side, version_of

MIN_DSC = 0.9


def hd95(quick: bool) -> Claim:
    """HD95 of masks beside MONAI's."""
    from bench_metrics import monai_hd95

    from models.metrics.masks import hd95_mm

    # Warnings of the peer about masks that it takes for labels cost it nothing.
    peer = Side("compute_hausdorff_distance", _each(monai_hd95), version_of("monai"))
    return _distance_claim(
        "HD95 of masks",
        hd95_mm,
        peer,
        lambda first, second: max(
            np.percentile(_pixel_distances_mm(*pair), 95) for pair in ((first, second), (second, first))
        ),
        "greatest difference from all pairs of boundary pixels, mm",
        quick,
    )


def hd95_surfel(quick: bool) -> Claim:
    """The same with boundaries between pixels, weighed by length, beside surface-distance."""
    from bench_metrics import surfel_hd95

    from models.metrics.masks import hd95_surfel_mm

    peer = Side("compute_robust_hausdorff", _each(surfel_hd95), version_of("surface-distance"))
    return _distance_claim(
        "Surface distance of masks",
        hd95_surfel_mm,
        peer,
        surfel_hd95,
        "greatest difference from surface-distance, mm",
        quick,
    )


def _distance_claim(
    title: str,
    ours: Callable[..., float],
    peer: Side,
    exact: Callable[[np.ndarray, np.ndarray], float],
    error_name: str,
    quick: bool,
) -> Claim:
    from bench_metrics import SPACING_MM, vessel

    pairs = [
        (vessel((150, 300), (25, 35), 0.0), vessel((155, 296), (28, 33), 1.0)),
        (vessel((250, 260), (120, 150), 0.0), vessel((258, 255), (125, 140), 1.0)),
        (vessel((100, 90), (40, 40), 0.0), vessel((400, 420), (60, 50), 1.0)),
    ]
    known_mm = np.array([exact(*pair) for pair in pairs])
    return Claim(
        title,
        "three pairs of masks of 512 x 512 px with a small and a large vessel and a far miss",
        Side(ours.__name__, _each(lambda first, second: ours(first, second, SPACING_MM))),
        lambda _, found_mm: np.abs(np.array(found_mm) - known_mm).max(),
        error_name,
        1e-4,
        [peer],
        lambda number: pairs,
        1 if quick else 15,
    )


def closing(quick: bool) -> Claim:
    """Closing of masks by a disc, beside SciPy, and scikit-image's way, which was this project's."""
    from bench_metrics import vessel
    from scipy import ndimage
    from skimage.morphology import disk, isotropic_closing

    from models.postprocessing.morphology import Morphology

    radius_px, ours = 9, Morphology(closing_radius_px=9.0)
    rng = np.random.default_rng(0)
    # None of them comes near the border, beyond which programs differ.
    masks = [
        vessel((250, 260), (radius, radius + 30), float(radius)) & (rng.random((512, 512)) > 0.1)
        for radius in (40, 80, 120)
    ]
    element = disk(radius_px)
    known = [ndimage.binary_closing(mask, element) for mask in masks]

    def side(name: str, close: Callable[[np.ndarray], np.ndarray], version: str = "") -> Side:
        return Side(name, lambda given: [close(mask) for mask in given], version)

    return Claim(
        "Closing of masks",
        f"three masks of 512 x 512 px by a disc of {radius_px} px",
        side("Morphology", lambda mask: ours(mask, None)),
        lambda _, found: sum(int((one != other).sum()) for one, other in zip(found, known, strict=True)),
        "pixels that differ from binary_closing",
        0.0,
        [
            side("binary_closing", lambda mask: ndimage.binary_closing(mask, element), version_of("scipy")),
            side(
                "isotropic_closing: by distance transforms, this project's earlier way",
                lambda mask: isotropic_closing(mask, radius_px),
                version_of("scikit-image"),
            ),
        ],
        lambda number: masks,
        1 if quick else 7,
    )


def _each(distance: Callable[[np.ndarray, np.ndarray], float]) -> Callable[[Any], list[float]]:
    return lambda pairs: [distance(*pair) for pair in pairs]


def _pixel_distances_mm(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """From each boundary pixel of a mask to the nearest of another, by all pairs."""
    from bench_metrics import SPACING_MM
    from scipy.ndimage import binary_erosion
    from scipy.spatial.distance import cdist

    places_mm = [np.argwhere(mask & ~binary_erosion(mask)) * SPACING_MM for mask in (first, second)]
    return np.asarray(cdist(*places_mm).min(axis=1))


def step(name: str, quick: bool) -> Claim:
    """A training step of one of our networks beside MONAI's of equal size."""
    import torch
    from bench_networks import ALIKE, PEERS, calls, recipes_of

    size, width, batch = (32, 4, 2) if quick else (128, 16, 8)
    given = argparse.Namespace(batch=batch, size=size, device="cpu", precision="32")
    recipes = recipes_of(width)
    torch.manual_seed(0)
    chosen = [name, PEERS[name], *([ALIKE] if name == "unet" else [])]
    networks = {each: recipes[each]() for each in chosen}
    sides = []
    for each, network in networks.items():
        millions = sum(values.numel() for values in network.parameters()) / 1e6
        own = each == name
        shown = each if own or each == ALIKE else f"{each} as MONAI has it"
        sides.append(
            Side(
                f"{shown}, {millions:.2f}M values",
                _Steps(calls(network, given)[0]),
                "" if own else version_of("monai"),
            )
        )
    return Claim(
        f"Training step, {name}",
        f"a step of AdamW on {batch} images of {size} x {size} px",
        sides[0],
        lambda _, share: share,
        "loss by that of the first step",
        1.0,
        sides[1:],
        rounds=1 if quick else 5,
        remarks=[
            "Networks of one plan and size, not the same functions: MONAI's own defaults have other normalisations."
        ],
    )


class _Steps:
    """A step of a training and its loss, as a share of that of the first step."""

    def __init__(self, step: Callable[[], Any]) -> None:
        self.step = step
        self.first = 0.0

    def __call__(self, _: object) -> float:
        loss = float(self.step())
        self.first = self.first or loss
        return loss / self.first


def training(quick: bool) -> Claim:
    """A whole training, from frames in memory, beside MONAI's cache and transforms in a bare loop."""
    from bench_training import fitted

    images, size, width, epochs = (8, 32, 4, 1) if quick else (64, 96, 16, 4)
    problem = _discs_problem(images, size, width, epochs)
    return Claim(
        "Training, whole epochs",
        f"{epochs} epochs of {images} images and {images // 4} to validate, {size} x {size} px, U-Net of width {width}",
        Side("trainer.fit with our augmentation", lambda posed: fitted(posed, None)[1]),
        lambda _, dsc: 1 - dsc,
        "1 - DSC of the validation images",
        1 - MIN_DSC,
        [Side("CacheDataset, dictionary transforms, a bare loop", in_monai, version_of("monai"))],
        lambda number: problem,
        1 if quick else 3,
        warm_up=False,
        remarks=[
            "The same network, optimiser, learning rates and loss; each side has the augmentation of its library with "
            "the same probabilities and sizes, MONAI without speckle that grows with the echo and gain by depth (it "
            "has noise and a scaled contrast). Ours also keeps the best weights."
        ],
    )


def _discs_problem(images: int, size: int, width: int, epochs: int) -> Any:
    from bench_training import problem_of

    return problem_of(
        argparse.Namespace(
            model="unet", width=width, size=size, batch=8, images=images, epochs=epochs, gpu=False
        )
    )


@dataclass(frozen=True)
class _Frames:
    """Files with discs, the true masks, and a folder for those that are found."""

    paths: list[Path]
    masks: np.ndarray
    out: Path


def inference(quick: bool) -> Claim:
    """Files to files: frames read, segmented and their masks written, beside MONAI's transforms."""
    from bench_inference import file_to_mask
    from bench_training import discs, fitted
    from monai_training import file_to_mask as by_monai
    from PIL import Image

    from models.checkpoint import Checkpoint
    from models.inference.engines import chosen_engine
    from models.predictor import Predictor

    count, size, width, epochs = (2, 32, 4, 1) if quick else (16, 128, 16, 8)
    folder = Path(tempfile.mkdtemp())
    fitted(_discs_problem(8 if quick else 32, size, width, epochs), folder / "training")
    newest = max((folder / "training").glob("model-*.pt"), key=lambda path: path.stat().st_mtime)
    frames = discs(count, size * 4 // 3)
    paths = [folder / f"{index:03d}.png" for index in range(count)]
    for path, image in zip(paths, frames.images, strict=True):
        Image.fromarray(image).save(path)
    (folder / "masks").mkdir()
    problem = _Frames(paths, np.stack(frames.masks), folder / "masks")
    predictor = Predictor.load(newest, engine="auto")
    checkpoint = Checkpoint.load(newest)

    def found(call: Callable[..., Any], posed: _Frames) -> np.ndarray:
        call(posed.paths, posed.out)
        return np.stack([np.asarray(Image.open(posed.out / path.name)) > 0 for path in posed.paths])

    def error(posed: _Frames, masks: np.ndarray) -> float:
        return 1 - 2 * float((masks & posed.masks).sum()) / float(masks.sum() + posed.masks.sum())

    network = checkpoint.recipe()
    network.load_state_dict(dict(checkpoint.weights))
    return Claim(
        "Inference, file to file",
        f"{count} PNG files of {size * 4 // 3} px read, segmented at {size} px and their masks written",
        Side(
            f"Predictor, engine=auto ({chosen_engine('auto', 'cpu')})",
            partial(found, partial(file_to_mask, predictor)),
        ),
        error,
        "1 - DSC to the discs that were drawn",
        1 - MIN_DSC,
        [
            Side(
                "LoadImage, Resize, the same weights in torch, Resize back",
                partial(found, partial(by_monai, network.eval(), size)),
                version_of("monai"),
            )
        ],
        lambda number: problem,
        1 if quick else 5,
        remarks=["Reading the masks back, to check them, is part of both sides' seconds."],
    )
