import numpy as np
import pytest

from models.errors import InputError
from models.inference.frames import Frame, batches_of, frames_of, is_one_frame


@pytest.mark.parametrize(
    ("shape", "count"),
    [((8, 9), 1), ((8, 9, 3), 1), ((8, 9, 4), 1), ((5, 8, 9), 5), ((5, 8, 9, 3), 5), ((0, 8, 9), 0)],
)
def test_an_array_is_one_frame_or_a_stack(shape: tuple[int, ...], count: int) -> None:
    frames = frames_of(np.zeros(shape, np.uint8), (0.1, 0.2))
    assert len(frames) == count and is_one_frame(np.zeros(shape)) == (count == 1)
    assert all(frame.size == (8, 9) and frame.spacing_mm == (0.1, 0.2) for frame in frames)


def test_a_list_may_mix_sizes_and_colours() -> None:
    frames = frames_of([np.zeros((4, 5), np.uint8), np.full((6, 7, 3), 9, np.uint8)], None)
    assert [frame.size for frame in frames] == [(4, 5), (6, 7)]
    np.testing.assert_array_equal(frames[1].grey, np.full((6, 7), 9))


def test_refuses_other_shapes_and_types() -> None:
    for wrong in (
        np.zeros((4, 5)),
        np.zeros((4, 0), np.uint8),
        np.zeros(3, np.uint8),
        np.zeros((2, 3, 4, 5), np.uint8),
    ):
        with pytest.raises(InputError, match="frames: expected uint8 of shape"):
            frames_of(wrong, None)
        with pytest.raises(InputError, match="frames: expected uint8 of shape"):
            Frame(wrong)


def test_batches_take_no_more_from_a_stream_than_they_need() -> None:
    taken: list[int] = []

    def stream():
        for index in range(5):
            taken.append(index)
            yield Frame(np.zeros((2, 2), np.uint8))

    batches = batches_of(stream(), 2)
    assert len(next(batches)) == 2 and taken == [0, 1]
    assert [len(batch) for batch in batches] == [2, 1]
