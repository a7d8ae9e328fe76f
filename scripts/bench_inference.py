"""Frames a second from file to mask: a network of 2 million parameters by each engine that is installed, in turn."""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from quick_budget import parsed

from experiments.datasets.images.image_files import read_grey
from models.inference.engines import PACKAGES, is_installed
from models.model_file import ModelMember, SegmentationModel
from models.networks.unet import UNet
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing


def written_frames(folder: Path, count: int, size: int) -> list[Path]:
    """Frames of smooth noise as PNG files, a third larger than what the network sees."""
    rng = np.random.default_rng(0)
    paths = [folder / f"{index}.png" for index in range(count)]
    for path in paths:
        coarse = rng.integers(0, 256, (size // 16, size // 12), dtype=np.uint8)
        Image.fromarray(coarse).resize((size * 4 // 3, size), Image.Resampling.BICUBIC).save(path)
    return paths


def model_of(size: int, width: int) -> SegmentationModel:
    """A U-Net with statistics of its own in the batch normalisations, as after a training."""
    torch.manual_seed(0)
    network = UNet(width)()
    with torch.no_grad():
        network.train()
        for _ in range(4):
            network(torch.randn(2, 1, size, size))
    return SegmentationModel((ModelMember("unet", UNet(width), network.state_dict()),), Preprocessing(size))


def file_to_mask(predictor: Predictor, paths: list[Path], out: Path) -> tuple[float, float, float]:
    """Seconds a frame from reading each file to writing its mask: by the clock, in the network, of all cores."""
    begin_s, begin_cpu_s = time.perf_counter(), time.process_time()
    network_s = 0.0
    for path, found in zip(paths, predictor.stream(map(read_grey, paths)), strict=True):
        Image.fromarray(found.mask).save(out / path.name)
        network_s += found.times.network_s
    spent = time.perf_counter() - begin_s, network_s, time.process_time() - begin_cpu_s
    return tuple(each / len(paths) for each in spent)


def main() -> None:
    """Print a line for each engine: medians over rounds in which all take turns, and how exact it is.

    Of a busy machine quote ``ratio`` and ``cpu_s`` (seconds of all cores a frame), not frames a second.
    """
    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser(description=__doc__)
    for name, default in (("size", 256), ("width", 16), ("frames", 8), ("batch", 8), ("rounds", 5)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--without", nargs="*", default=[], help="engines to leave out")
    given = parsed(parser, {"size": 64, "width": 8, "frames": 2, "rounds": 1, "without": ["compiled"]})
    torch.set_num_threads(given.threads)
    engines = ["eager", "compiled", *(name for name in PACKAGES if is_installed(name))]
    model = model_of(given.size, given.width)
    parameters = model.members[0].parameters
    print(
        f"{parameters / 1e6:.2f}M values, {given.size} px, {given.threads} threads, batches of {given.batch}"
    )
    with tempfile.TemporaryDirectory() as folder:
        paths = written_frames(Path(folder), given.frames, given.size)
        (out := Path(folder) / "masks").mkdir()
        frames = [read_grey(path) for path in paths]
        predictors, start_s, maps = {}, {}, {}
        for engine in (name for name in engines if name not in given.without):
            begin_s = time.perf_counter()
            predictors[engine] = Predictor.from_model(model, given.batch, engine=engine)
            maps[engine] = np.stack(predictors[engine].probability(frames))
            start_s[engine] = time.perf_counter() - begin_s
        rounds = [
            {engine: file_to_mask(predictor, paths, out) for engine, predictor in predictors.items()}
            for _ in range(given.rounds)
        ]
    eager_s = [each["eager"][0] for each in rounds]
    print(
        f"{'engine':12s}{'frames/s':>9s}{'best':>7s}{'ratio':>7s}{'network':>9s}{'start_s':>9s}  max difference"
    )
    for engine in predictors:
        times = [each[engine] for each in rounds]
        rate = 1 / statistics.median(total for total, *_ in times)
        ratio = statistics.median(eager / total for eager, (total, *_) in zip(eager_s, times, strict=True))
        network = statistics.median(inner / total for total, inner, _ in times)
        cpu_s = statistics.median(cpu for *_, cpu in times)
        difference = float(np.abs(maps[engine] - maps["eager"]).max())
        print(
            f"{engine:12s}{rate:9.1f}{1 / min(total for total, *_ in times):7.1f}{ratio:7.2f}{network:9.0%}"
            f"{cpu_s:7.3f}{start_s[engine]:9.1f}  {difference:.1e}"
        )


if __name__ == "__main__":
    main()
