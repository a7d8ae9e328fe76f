import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from dicom_files import write_dicom
from PIL import Image
from sweeps import known_sweep

from experiments.errors import InputError
from experiments.outcome import Silent
from experiments.paths import project_root
from experiments.studies import segment
from experiments.studies.segment import study
from experiments.studies.segment.sources import sources_of
from models.errors import InputError as ModelInputError
from models.model_file import ModelMember, SegmentationModel
from models.networks.unet import UNet
from models.postprocessing.hysteresis import Hysteresis
from models.postprocessing.morphology import Morphology
from models.postprocessing.options import Option
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing
from registration.readers.auto import AutoReader
from registration.readers.folder import write_folder

SETTINGS = ("threshold", "low", "high", "relative", "min_peak", "min_presence", "min_area_px", "min_area_mm2")
NONE = dict.fromkeys((*SETTINGS, "fill_holes", "largest_only", "flips"))


@pytest.fixture
def model(tmp_path: Path) -> Path:
    torch.manual_seed(1)
    recipe = UNet(width=2, depth=2, normalisation="none")
    option = Option(Hysteresis(0.45, 0.5), Morphology(min_area_px=2))
    member = ModelMember("a", recipe, recipe().state_dict())
    path = tmp_path / "model.pt"
    SegmentationModel(
        (member,), Preprocessing(32), postprocessing=option, certificate={"verdict": "single"}
    ).save(path)
    return path


def noise(height: int, width: int, seed: int = 0, channels: tuple[int, ...] = ()) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, *channels), dtype=np.uint8)


def saved(path: Path, image: np.ndarray) -> np.ndarray:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path)
    return image


def run(model: Path, source: Path, workspace: Path, **changes: Any) -> Any:
    workspace.mkdir(exist_ok=True)
    settings = {
        "model_path": str(model), "input": str(source), "acquisition": AutoReader(), "spacing_mm": None,
        "engine": "eager", "device": "cpu", "batch_size": 2, "overlays": False, "resume": False,
        "out": None, "workspace": workspace, "progress": Silent(), **NONE,
    }  # fmt: skip
    return segment.run(**{**settings, **changes})


def mask_of(path: Path) -> np.ndarray:
    values = np.asarray(Image.open(path))
    assert values.dtype == np.uint8 and set(np.unique(values)) <= {0, 255}
    return values > 0


def report_of(workspace: Path) -> dict[str, Any]:
    return json.loads((workspace / "segmentation.json").read_text())


def test_images_of_mixed_sizes_modes_and_folders_get_masks_of_their_names(home, tmp_path, model) -> None:
    folder = tmp_path / "in"
    images = {
        "a.png": saved(folder / "a.png", noise(40, 30)),
        "sub/b.png": saved(folder / "sub" / "b.tif", noise(20, 50, 1)),
        "sub/a.png": saved(folder / "sub" / "a.bmp", noise(33, 33, 2)),
    }
    saved(folder / "colour.png", noise(40, 30, 3, (3,)))
    (folder / "notes.txt").write_text("no image")
    (folder / ".hidden.png").write_bytes(b"")
    outcome = run(model, folder, tmp_path / "out")
    predictor = Predictor.load(model)
    for name, image in images.items():
        np.testing.assert_array_equal(mask_of(tmp_path / "out" / name), predictor(image))
    assert mask_of(tmp_path / "out" / "colour.png").shape == (40, 30)
    report = report_of(tmp_path / "out")
    assert [row["mask"] for row in report["images"]] == ["a.png", "colour.png", "sub/a.png", "sub/b.png"]
    first = report["images"][0]
    assert first["area_px"] == int(predictor(images["a.png"]).sum()) > 0 and first["area_mm2"] is None
    assert (first["height_px"], first["width_px"], first["presence"]) == (40, 30, None)
    assert 0.4 < first["confidence"] <= 1 and first["network_s"] > 0
    assert report["model"]["digest"] == SegmentationModel.load(model).digest
    assert report["totals"]["images"] == 4 and outcome.metrics["images"] == 4 and outcome.refused == ()
    assert any("certificate: single" in said for said in outcome.findings)
    assert "frames a second" in outcome.findings[-2]
    assert not (tmp_path / "out" / "overlays").exists()


def test_names_that_differ_in_suffix_or_case_alone_are_made_distinct(home, tmp_path, model) -> None:
    folder = tmp_path / "in"
    for name in ("a.png", "a.bmp", "A.tif", "a.bmp.png", "overlays/c.png"):
        saved(folder / name, noise(16, 16))
    run(model, folder, tmp_path / "out", overlays=True)
    names = [row["name"] for row in report_of(tmp_path / "out")["images"]]
    assert len({name.casefold() for name in names}) == 5 and "input_overlays/c" in names
    for name in names:
        assert mask_of(tmp_path / "out" / f"{name}.png").shape == (16, 16)
        picture = np.asarray(Image.open(tmp_path / "out" / "overlays" / f"{name}.png"))
        outlined = (picture == (255, 210, 0)).all(axis=2)
        mask = mask_of(tmp_path / "out" / f"{name}.png")
        assert outlined.any() and not (outlined & ~mask).any()


def test_an_unreadable_image_is_named_and_the_others_are_done(home, tmp_path, model) -> None:
    folder = tmp_path / "in"
    saved(folder / "a.png", noise(16, 16))
    (folder / "b.png").write_bytes(b"\x89PNG no image")
    saved(folder / "c.png", noise(16, 16, 1))
    outcome = run(model, folder, tmp_path / "out")
    assert [row["name"] for row in report_of(tmp_path / "out")["images"]] == ["a", "c"]
    (refused,) = outcome.refused
    assert "b.png: expected an image, received a file that can't be read as one" in refused
    assert report_of(tmp_path / "out")["unreadable"] == [refused] and outcome.metrics["unreadable"] == 1
    for name in ("a", "c"):
        (folder / f"{name}.png").unlink()
    with pytest.raises(InputError, match=r"input: expected images that can be read, found none \(.*b\.png"):
        run(model, folder, tmp_path / "none")


def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The number of frames that pass through the network, call by call."""
    seen: list[int] = []
    prepared = Predictor._squares

    def counting(self: Predictor, batch: Any) -> torch.Tensor:
        seen.append(len(batch))
        return prepared(self, batch)

    monkeypatch.setattr(Predictor, "_squares", counting)
    return seen


def test_resuming_segments_only_what_the_same_model_has_not_segmented(
    home, tmp_path, model, monkeypatch
) -> None:
    folder = tmp_path / "in"
    for index in range(3):
        saved(folder / f"{index}.png", noise(16, 20, index))
    first = run(model, folder, tmp_path / "first")
    seen = counted(monkeypatch)
    (folder / "1.png").rename(folder / "renamed.png")
    saved(folder / "3.png", noise(20, 16, 9))
    again = run(model, folder, tmp_path / "again", resume=True)
    assert sum(seen) == 1 and again.metrics["resumed"] == 3 and first.metrics["resumed"] == 0
    np.testing.assert_array_equal(
        mask_of(tmp_path / "again" / "renamed.png"), mask_of(tmp_path / "first" / "1.png")
    )
    assert [row["name"] for row in report_of(tmp_path / "again")["images"]] == ["0", "2", "3", "renamed"]
    # Another threshold is another model, and without resume nothing is taken over.
    assert run(model, folder, tmp_path / "b", resume=True, threshold=0.3).metrics["resumed"] == 0
    assert run(model, folder, tmp_path / "c").metrics["resumed"] == 0
    saved(folder / "0.png", noise(16, 20, 77))
    assert run(model, folder, tmp_path / "d", resume=True, overlays=True).metrics["resumed"] == 3
    assert len(list((tmp_path / "d" / "overlays").iterdir())) == 4


def test_what_was_done_before_a_failure_is_kept(home, tmp_path, model, monkeypatch) -> None:
    folder = tmp_path / "in"
    for index in range(4):
        saved(folder / f"{index}.png", noise(16, 20, index))

    def full(*given: Any) -> None:
        if "3" in str(given[1].name):
            raise OSError("No space left on device")

    with monkeypatch.context() as broken:
        broken.setattr(study._Work, "_deliver", full)
        with pytest.raises(OSError, match="No space left"):
            run(model, folder, tmp_path / "out")
    assert run(model, folder, tmp_path / "out", resume=True).metrics["resumed"] == 4
    assert (project_root() / ".cache" / "segment").is_dir()


def test_a_sweep_has_masks_of_its_frames_names_and_areas_in_mm2(home, tmp_path, model) -> None:
    write_folder(tmp_path / "sweep", known_sweep())
    run(model, tmp_path / "sweep", tmp_path / "out")
    rows = report_of(tmp_path / "out")["images"]
    sweep = AutoReader()(tmp_path / "sweep")
    assert len(rows) == len(sweep.images)
    height_mm, width_mm = sweep.calibration.spacing_mm
    for row, image in zip(rows, sweep.images, strict=True):
        np.testing.assert_array_equal(
            mask_of(tmp_path / "out" / row["mask"]), Predictor.load(model)(image, (height_mm, width_mm))
        )
        assert row["area_mm2"] == pytest.approx(row["area_px"] * height_mm * width_mm)


def test_dicom_frames_are_numbered_and_have_their_files_pixel_size(home, tmp_path, model) -> None:
    pytest.importorskip("pydicom")
    (tmp_path / "in").mkdir()
    write_dicom(tmp_path / "in" / "IM0001", np.stack([noise(20, 24, seed) for seed in range(3)]))
    run(model, tmp_path / "in", tmp_path / "out", spacing_mm=[0.5, 0.25])
    rows = report_of(tmp_path / "out")["images"]
    assert [row["mask"] for row in rows] == [f"IM0001_{number:05d}.png" for number in range(3)]
    assert all(row["area_mm2"] == pytest.approx(row["area_px"] * 0.125) for row in rows)


def test_a_video_is_segmented_frame_by_frame(home, tmp_path, model, monkeypatch) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(b"video")
    pictures = [noise(16, 20, seed, (3,)) for seed in range(5)]

    class Container:
        def __enter__(self) -> "Container":
            return self

        def __exit__(self, *error: object) -> None:
            pass

        def decode(self, video: int) -> Any:
            for picture in pictures:
                yield SimpleNamespace(to_ndarray=lambda format, picture=picture: picture)

    monkeypatch.setitem(
        __import__("sys").modules, "av", SimpleNamespace(open=lambda name: Container(), FFmpegError=OSError)
    )
    run(model, path, tmp_path / "out")
    names = [row["mask"] for row in report_of(tmp_path / "out")["images"]]
    assert names == [f"clip_{number:05d}.png" for number in range(5)]
    np.testing.assert_array_equal(mask_of(tmp_path / "out" / names[4]), Predictor.load(model)(pictures[4]))
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    with pytest.raises(InputError, match=r"expected the package av to read a video.*ctus\[video\]"):
        run(model, path, tmp_path / "none")


def test_a_real_video_is_read(tmp_path) -> None:
    av = pytest.importorskip("av")
    with av.open(str(tmp_path / "clip.mp4"), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for level in (0, 120, 240):
            picture = np.full((48, 64, 3), level, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    from experiments.studies.segment.sources import read_video

    frames = list(read_video(tmp_path / "clip.mp4"))
    assert [frame.shape for frame in frames] == [(48, 64, 3)] * 3
    assert [round(float(frame.mean()) / 120) for frame in frames] == [0, 1, 2]
    (tmp_path / "broken.mp4").write_bytes(b"no video")
    with pytest.raises(InputError, match=r"broken\.mp4: expected a video"):
        list(read_video(tmp_path / "broken.mp4"))


def test_a_call_sets_thresholds_of_its_own(home, tmp_path, model) -> None:
    image = saved(tmp_path / "in" / "a.png", noise(40, 40))
    probability = Predictor.load(model).probability(image)
    run(model, tmp_path / "in" / "a.png", tmp_path / "out", threshold=0.55, min_area_px=0.0)
    np.testing.assert_array_equal(mask_of(tmp_path / "out" / "a.png"), probability >= np.float32(0.55))
    with pytest.raises(InputError, match="threshold: expected none with low or high"):
        run(model, tmp_path / "in", tmp_path / "b", threshold=0.5, low=0.3)
    with pytest.raises(ModelInputError, match=r"low, high: expected 0 < low <= high <= 1, received 0.9"):
        run(model, tmp_path / "in", tmp_path / "b", low=0.9)
    with pytest.raises(InputError, match="spacing_mm: expected one or two positive numbers"):
        run(model, tmp_path / "in", tmp_path / "b", spacing_mm=0.0)


def test_refuses_what_can_be_seen_to_be_wrong(home, tmp_path, model) -> None:
    folder = tmp_path / "in"
    saved(folder / "a.png", noise(16, 16))
    here = {"model_path": str(model), "input": str(folder), "out": None}
    study.check(**here)
    study.check(**(here | {"out": str(tmp_path / "out")}))
    for out in (folder, folder / "masks", folder / "x" / ".."):
        with pytest.raises(InputError, match="out: expected a folder apart from the input's"):
            study.check(**(here | {"out": str(out)}))
    with pytest.raises(InputError, match="out: expected a folder apart"):
        study.check(**(here | {"input": str(folder / "a.png"), "out": str(folder)}))
    with pytest.raises(InputError, match="model_path: expected a model file"):
        study.check(**(here | {"model_path": str(tmp_path / "absent.pt")}))
    with pytest.raises(InputError, match="input: expected a file or folder"):
        study.check(**(here | {"input": str(tmp_path / "absent")}))
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"input: expected images .* found none"):
        study.check(**(here | {"input": str(tmp_path / "empty")}))
    (tmp_path / "text.txt").write_text("a")
    with pytest.raises(InputError, match=r"input: expected an image .* received .*text\.txt"):
        sources_of(tmp_path / "text.txt")
    torch.save({"format": "other"}, tmp_path / "other.pt")
    with pytest.raises(ModelInputError, match=r"other\.pt: expected a model of this program"):
        run(tmp_path / "other.pt", folder, tmp_path / "out")
