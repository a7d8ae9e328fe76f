import dataclasses

import numpy as np
import pytest
from drawn_vessels import drawn_frames

from models.errors import InputError
from models.labelled_frames import LabelledFrames


def frames(**changes: object) -> LabelledFrames:
    fields = {
        "images": (np.zeros((3, 4), np.uint8), np.ones((5, 2), np.uint8)),
        "masks": (np.zeros((3, 4), bool), np.ones((5, 2), bool)),
        "case_ids": ("a", "b"),
        "groups": ("g", "h"),
        "spacing_mm": (None, (0.1, 0.2)),
        "simulated": False,
    }
    return LabelledFrames(**{**fields, **changes})


def test_subset_keeps_order_and_everything_of_a_case() -> None:
    chosen = frames().subset([1, 0])
    assert chosen.case_ids == ("b", "a")
    assert chosen.groups == ("h", "g")
    assert chosen.spacing_mm == ((0.1, 0.2), None)
    assert [image.shape for image in chosen.images] == [(5, 2), (3, 4)]
    assert chosen.masks[0].all() and not chosen.masks[1].any()
    assert len(frames().subset([])) == 0


@pytest.mark.parametrize("field", ["masks", "case_ids", "groups", "spacing_mm"])
def test_refuses_fields_of_another_length(field: str) -> None:
    with pytest.raises(InputError, match=rf"{field}: expected one for each of 2 images, received 1"):
        frames(**{field: getattr(frames(), field)[:1]})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"masks": (np.zeros((3, 4), bool), np.ones((2, 5), bool))},
            r"size \(5, 2\), received \(2, 5\) in case b",
        ),
        ({"case_ids": ("a", "a")}, "unique names, received 'a' more than once"),
        (
            {"spacing_mm": (None, (0.1, 0.0))},
            r"positive pixel sizes or None, received \(0.1, 0.0\) in case b",
        ),
        ({"spacing_mm": (None, (0.1, float("nan")))}, "positive pixel sizes"),
        ({"images": (np.zeros((0, 4), np.uint8), np.ones((5, 2), np.uint8))}, "in case a"),
    ],
)
def test_refuses_a_case_that_does_not_fit(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        frames(**changes)


def test_what_was_saved_is_loaded(tmp_path) -> None:
    saved = frames()
    saved.save(tmp_path / "frames.npz")
    loaded = LabelledFrames.load(tmp_path / "frames.npz")
    assert loaded.digest() == saved.digest()
    for field in ("case_ids", "groups", "spacing_mm", "simulated"):
        assert getattr(loaded, field) == getattr(saved, field)
    for mine, theirs in zip(loaded.images + loaded.masks, saved.images + saved.masks, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert [path.name for path in tmp_path.iterdir()] == ["frames.npz"]


@pytest.mark.parametrize("content", [None, b"", b"no archive"])
def test_refuses_a_file_that_is_none(tmp_path, content: bytes | None) -> None:
    path = tmp_path / "frames.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"frames\.npz: expected a file of labelled frames"):
        LabelledFrames.load(path)


def test_refuses_a_truncated_file_and_an_archive_of_something_else(tmp_path) -> None:
    path = tmp_path / "frames.npz"
    drawn_frames(3).save(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="labelled frames"):
        LabelledFrames.load(path)
    np.savez(path, something=np.zeros(3))
    with pytest.raises(InputError, match="labelled frames"):
        LabelledFrames.load(path)


def test_digest_depends_on_every_pixel_name_and_spacing() -> None:
    base = frames()
    changed_image = base.images[0].copy()
    changed_image[0, 0] = 1
    changed_mask = base.masks[0].copy()
    changed_mask[0, 0] = True
    others = [
        dataclasses.replace(base, images=(changed_image, base.images[1])),
        dataclasses.replace(base, masks=(changed_mask, base.masks[1])),
        dataclasses.replace(base, case_ids=("a", "c")),
        dataclasses.replace(base, groups=("g", "g")),
        dataclasses.replace(base, spacing_mm=(None, None)),
    ]
    assert frames().digest() == base.digest()
    assert len({base.digest(), *(other.digest() for other in others)}) == 6
