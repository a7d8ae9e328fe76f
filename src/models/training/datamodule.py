"""The frames of one fold as a training takes them: prepared once, shuffled, augmented and normalised batch by batch."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import cast

import numpy as np
import torch
from lightning.pytorch import LightningDataModule
from torch import Generator, Tensor
from torch.utils.data import (
    BatchSampler,
    DataLoader,
    Dataset,
    RandomSampler,
    SequentialSampler,
    TensorDataset,
)

from models.array_types import Float
from models.labelled_frames import LabelledFrames
from models.preprocessing.preprocessing import Preprocessing
from models.seeds import AUGMENTATION, SHUFFLING, seed_of
from models.training.augmentation import Augmentation
from models.training.sampling import WHOLE, EmptyFrameSampler, Share

Batch = list[Tensor]


class FoldData(LightningDataModule):
    """Training and validation batches: normalised images (b, 1, s, s), and masks of 0 and 1 of the same shape.

    Parameters
    ----------
    train, validation : LabelledFrames
        Cases of either side.
    preprocessing : Preprocessing
        What all frames go through, once.
    augmentation : Augmentation
        Random transforms of training batches.
    batch_size : int
        Number of images in a batch.
    seed : int
        Seed of the shuffling and the augmentation.
    empty_weight : float, optional
        How often an image without a vessel is drawn in an epoch.
    targets : ndarray of float, shape (n, s, s), or None
        Probabilities that training frames have in the place of masks, at the network's size.
    share : Share, optional
        Which part of each training batch this process takes.
    """

    def __init__(
        self,
        train: LabelledFrames,
        validation: LabelledFrames,
        preprocessing: Preprocessing,
        augmentation: Augmentation,
        batch_size: int,
        seed: int,
        empty_weight: float = 1.0,
        targets: Float[np.ndarray, "n s s"] | None = None,
        share: Share = WHOLE,
    ) -> None:
        super().__init__()
        self.share = share
        self.preprocessing = preprocessing
        self.augmentation = augmentation
        self.batch_size = batch_size
        self.seed = seed
        self.train_set = prepared(train, preprocessing)
        self.binary = targets is None
        if targets is not None:
            self.train_set = TensorDataset(self.train_set.tensors[0], torch.from_numpy(targets)[:, None])
        self.validation_set = prepared(validation, preprocessing)
        self._shuffle_generator = Generator()
        self._order = self._training_order(empty_weight)
        self._augmentation_generator: Generator | None = None
        self.begin_epoch(0)

    def begin_epoch(self, epoch: int) -> None:
        """Seed the order of the images and their augmentation: both depend on the seed and the epoch alone.

        Parameters
        ----------
        epoch : int
            Number of the epoch, counted from 0.
        """
        self.epoch = epoch
        self._shuffle_generator.manual_seed(seed_of(self.seed, SHUFFLING, epoch))
        self._augmentation_generator = None

    @property
    def steps_per_epoch(self) -> int:
        """Number of batches in an epoch."""
        return -(-len(self._order) // self.batch_size)

    def train_dataloader(self) -> DataLoader[Batch]:
        """Load training batches, shuffled anew in each epoch.

        Returns
        -------
        DataLoader
            Images and masks at the network's size, not normalised.
        """
        return self._loader(self._order, self.train_set)

    def val_dataloader(self) -> DataLoader[Batch]:
        """Load validation batches in order.

        Returns
        -------
        DataLoader
            Images and masks at the network's size, not normalised.
        """
        return self._loader(SequentialSampler(self.validation_set), self.validation_set)

    def plain_training_images(self, device: torch.device) -> Iterator[Tensor]:
        """Take the training images as a network sees them in use: in order, not augmented.

        Parameters
        ----------
        device : torch.device
            Where they are needed.

        Yields
        ------
        Tensor, shape (b, 1, s, s)
            Normalised images in channels-last layout.
        """
        for images, _ in self._loader(SequentialSampler(self.train_set), self.train_set):
            normalised = self.preprocessing.normalise(images.to(device))
            yield normalised.contiguous(memory_format=torch.channels_last)

    def on_after_batch_transfer(self, batch: Batch, dataloader_idx: int) -> Batch:
        """Augment (in training) and normalise a batch on the device.

        Parameters
        ----------
        batch : list of Tensor
            Images and masks, shape (b, 1, s, s).
        dataloader_idx : int
            Not used.

        Returns
        -------
        list of Tensor
            Normalised images in channels-last layout, and masks of 0 and 1 or, in training, the targets given. Where
            several processes share a training batch, its part of them, and the weight of that part's mean loss.
        """
        images, masks = batch[0], batch[1].float()
        training = self.trainer is not None and self.trainer.training
        if training:
            if self._augmentation_generator is None:
                seed = seed_of(self.seed, AUGMENTATION, self.epoch)
                self._augmentation_generator = Generator(images.device).manual_seed(seed)
            images, masks = self.augmentation(images, masks, self._augmentation_generator, binary=self.binary)
        images = self.preprocessing.normalise(images)
        more: list[Tensor] = []
        if training and self.share.processes > 1:
            # Augmented as a whole before it is divided: the images are those of a training on one device.
            part, weight = self.share.of(len(images))
            images, masks, more = images[part], masks[part], [images.new_tensor(weight)]
        return [images.contiguous(memory_format=torch.channels_last), masks, *more]

    def _training_order(self, empty_weight: float) -> RandomSampler | EmptyFrameSampler:
        if empty_weight == 1:
            return RandomSampler(self.train_set, generator=self._shuffle_generator)
        # Soft targets are above 0 everywhere: half a vessel pixel is what shows one.
        shown = (self.train_set.tensors[1] >= 0.5).flatten(1).any(dim=1)
        return EmptyFrameSampler(shown, empty_weight, self._shuffle_generator)

    def _loader(self, order: Iterable[int], frames: TensorDataset) -> DataLoader[Batch]:
        # A whole batch is one indexing of a tensor; collating it from single images would cost more than the indexing.
        batches = BatchSampler(order, self.batch_size, drop_last=False)
        # A generator of its own keeps the loader from drawing on the stream that dropout draws from.
        return DataLoader(
            cast("Dataset[Batch]", frames), sampler=batches, batch_size=None, generator=Generator()
        )


def prepared(frames: LabelledFrames, preprocessing: Preprocessing) -> TensorDataset:
    """Preprocess all frames.

    Parameters
    ----------
    frames : LabelledFrames
        Cases of any sizes.
    preprocessing : Preprocessing
        What they go through.

    Returns
    -------
    TensorDataset
        Images of values 0 to 1 and masks of bool, shape (n, 1, s, s).
    """
    size = preprocessing.image_size_px
    images = torch.empty((len(frames), 1, size, size))
    masks = torch.empty((len(frames), 1, size, size), dtype=torch.bool)
    for index, (image, mask) in enumerate(zip(frames.images, frames.masks, strict=True)):
        images[index] = preprocessing(torch.tensor(np.array(image, order="C"))[None])[0]
        masks[index] = preprocessing.mask(torch.tensor(np.array(mask, order="C"))[None])[0] > 0
    return TensorDataset(images, masks)
