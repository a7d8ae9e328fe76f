from types import SimpleNamespace

import torch
from drawn_vessels import drawn_frames

from models.preprocessing.preprocessing import Preprocessing
from models.training.augmentation import Augmentation
from models.training.datamodule import FoldData, prepared

STAGE = Preprocessing(32)
NOTHING = Augmentation(())


def fold_data(seed: int = 0, augmentation: Augmentation = NOTHING) -> FoldData:
    return FoldData(drawn_frames(10), drawn_frames(5, seed=9), STAGE, augmentation, batch_size=4, seed=seed)


def test_prepared_is_what_the_predictor_does_to_a_frame() -> None:
    frames = drawn_frames(3)
    images, masks = prepared(frames, STAGE).tensors
    for index, image in enumerate(frames.images):
        assert torch.equal(images[index : index + 1], STAGE(torch.from_numpy(image)[None]))
    assert masks.dtype == torch.bool and masks.shape == (3, 1, 32, 32)
    assert 0.03 < float(masks.float().mean()) < 0.25


def test_frames_of_different_sizes_go_together() -> None:
    small, large = drawn_frames(2), drawn_frames(2, size=(90, 60))
    mixed = type(small)(
        small.images + large.images,
        small.masks + large.masks,
        ("a", "b", "c", "d"),
        small.groups + large.groups,
        small.spacing_mm + large.spacing_mm,
        True,
    )
    images, _ = prepared(mixed, STAGE).tensors
    assert torch.equal(images[2:], prepared(large, STAGE).tensors[0])


def test_an_epoch_shows_every_frame_once_and_the_last_batch_is_kept() -> None:
    data = fold_data()
    batches = [images for images, _ in data.train_dataloader()]
    assert [len(batch) for batch in batches] == [4, 4, 2] and data.steps_per_epoch == 3
    shown = sorted(tuple(image.flatten()[:50].tolist()) for image in torch.cat(batches))
    assert shown == sorted(tuple(image.flatten()[:50].tolist()) for image in data.train_set.tensors[0])


def test_empty_frames_are_drawn_as_often_as_asked() -> None:
    frames = drawn_frames(10, empty=4)
    data = FoldData(frames, drawn_frames(5), STAGE, NOTHING, batch_size=4, seed=0, empty_weight=2.0)
    masks = torch.cat([masks for _, masks in data.train_dataloader()])
    assert len(masks) == 6 + 2 * 4 and int((~masks.flatten(1).any(dim=1)).sum()) == 8
    assert data.steps_per_epoch == 4


def test_plain_images_are_those_of_a_network_in_use() -> None:
    data = fold_data(augmentation=Augmentation())
    plain = torch.cat(list(data.plain_training_images(torch.device("cpu"))))
    assert torch.equal(plain, STAGE.normalise(data.train_set.tensors[0]))


def test_shuffling_follows_the_seed_and_differs_between_epochs() -> None:
    def epochs(seed: int, *numbers: int) -> list[torch.Tensor]:
        data = fold_data(seed)
        loader, shown = data.train_dataloader(), []
        for number in numbers:
            data.begin_epoch(number)
            shown.append(torch.cat([images for images, _ in loader]))
        return shown

    first, second = epochs(0, 0, 1)
    assert not torch.equal(first, second)
    assert torch.equal(second, epochs(0, 1)[0])  # whether or not there was an epoch before
    assert not torch.equal(first, epochs(1, 0)[0])


def test_loading_leaves_the_stream_that_dropout_draws_from_alone() -> None:
    data = fold_data()
    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    list(data.train_dataloader())
    list(data.val_dataloader())
    assert torch.equal(torch.rand(1), expected)


def test_validation_is_in_order() -> None:
    data = fold_data()
    images = torch.cat([batch[0] for batch in data.val_dataloader()])
    assert torch.equal(images, data.validation_set.tensors[0])


def test_batches_are_normalised_always_and_augmented_in_training_alone() -> None:
    data = fold_data(augmentation=Augmentation())
    batch = next(iter(data.val_dataloader()))
    data.trainer = SimpleNamespace(training=False)
    images, masks = data.on_after_batch_transfer(batch, 0)
    assert torch.equal(images, STAGE.normalise(batch[0])) and torch.equal(masks, batch[1].float())
    data.trainer = SimpleNamespace(training=True)
    changed, again = (data.on_after_batch_transfer(batch, 0)[0] for _ in range(2))
    assert not torch.equal(changed, images) and not torch.equal(changed, again)
    fresh = fold_data(augmentation=Augmentation())
    fresh.trainer = SimpleNamespace(training=True)
    assert torch.equal(fresh.on_after_batch_transfer(batch, 0)[0], changed)
    fresh.begin_epoch(1)
    assert not torch.equal(fresh.on_after_batch_transfer(batch, 0)[0], changed)
    fresh.begin_epoch(0)
    assert torch.equal(fresh.on_after_batch_transfer(batch, 0)[0], changed)
