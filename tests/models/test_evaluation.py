import numpy as np
from drawn_vessels import drawn_frames
from torch import Tensor, nn

from models.evaluation import predict, score_cases
from models.labelled_frames import LabelledFrames
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing


class DarkIsVessel(nn.Module):
    def forward(self, images: Tensor) -> Tensor:
        return 50 * (0.35 - images)


PREDICTOR = Predictor(DarkIsVessel(), Preprocessing(48, "unit"), batch_size=2)


def mixed() -> LabelledFrames:
    small, large = drawn_frames(3, spacing_mm=None), drawn_frames(3, size=(90, 60), seed=1, empty=1)
    fields = {
        name: getattr(small, name) + getattr(large, name)
        for name in ("images", "masks", "groups", "spacing_mm")
    }
    return LabelledFrames(case_ids=tuple("abcdef"), simulated=True, **fields).subset([0, 3, 1, 4, 2, 5])


def test_each_case_gets_the_mask_of_its_own_frame() -> None:
    frames = mixed()
    predictions = dict(predict(PREDICTOR, frames))
    assert sorted(predictions) == list("abcdef")
    for case, image in zip(frames.case_ids, frames.images, strict=True):
        np.testing.assert_array_equal(predictions[case], PREDICTOR(image[None])[0])


def test_rows_say_what_was_scored_and_score_it() -> None:
    frames = mixed()
    rows = score_cases(
        frames, dict(zip(frames.case_ids, frames.masks, strict=True)), {"fold": 1, "model": "unet"}
    )
    assert [row["case_id"] for row in rows] == list(frames.case_ids)
    by_case = {row["case_id"]: row for row in rows}
    assert {row["fold"] for row in rows} == {1} and {row["simulated"] for row in rows} == {True}
    assert by_case["a"]["dsc"] == 1.0 and np.isnan(by_case["a"]["hd95_mm"]) and by_case["a"]["hd95_px"] == 0.0
    assert by_case["e"]["hd95_mm"] == 0.0
    assert np.isnan(by_case["d"]["dsc"]) and by_case["d"]["false_alarm"] == 0.0
    assert by_case["b"]["group"] == "sweep0"
