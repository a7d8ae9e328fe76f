"""How fast a training goes and how much memory it takes, measured where nothing else is counted."""

from __future__ import annotations

import resource
import sys
import time

import torch


class Throughput:
    """Images per second over the training batches of an epoch; what lies between epochs is not counted.

    Parameters
    ----------
    device : torch.device
        Where the network is trained.
    """

    def __init__(self, device: torch.device) -> None:
        self.device = device
        self._images = 0
        self._start_s = self._end_s = time.perf_counter()

    def start(self) -> None:
        """Start the clock: an epoch's first batch is about to be fetched."""
        self._images = 0
        self._start_s = self._end_s = time.perf_counter()

    def count(self, images: int, last: bool) -> None:
        """Count the images of a batch.

        Parameters
        ----------
        images : int
            Number of images.
        last : bool
            Whether it is the epoch's last batch, after which a GPU is waited for.
        """
        self._images += images
        if last:
            if self.device.type == "cuda":
                torch.cuda.synchronize(self.device)
            self._end_s = time.perf_counter()

    @property
    def images_per_s(self) -> float:
        """Images per second of the epoch whose last batch is done."""
        return self._images / (self._end_s - self._start_s)


def peak_memory_mb(device: torch.device) -> float:
    """Return the largest amount of memory taken so far.

    Parameters
    ----------
    device : torch.device
        Where the network is trained.

    Returns
    -------
    float
        10^6 bytes: of tensors on a GPU, otherwise of the whole process.
    """
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device) / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Kilobytes on Linux, bytes on macOS.
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
