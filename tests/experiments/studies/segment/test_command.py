"""The study from the command line: what is left, and the exit code."""

from pathlib import Path

import numpy as np
import torch
from PIL import Image

from experiments.cli import main
from models.model_file import ModelMember, SegmentationModel
from models.networks.unet import UNet
from models.preprocessing.preprocessing import Preprocessing


def test_all_that_can_be_read_is_done_and_the_exit_code_says_what_could_not(
    home: Path, tmp_path: Path, capsys
) -> None:
    recipe = UNet(width=2, depth=2)
    torch.manual_seed(0)
    SegmentationModel((ModelMember("a", recipe, recipe().state_dict()),), Preprocessing(16)).save(
        tmp_path / "model.pt"
    )
    (tmp_path / "in").mkdir()
    image = np.random.default_rng(0).integers(0, 256, (20, 30), dtype=np.uint8)
    Image.fromarray(image).save(tmp_path / "in" / "a.png")
    words = [
        "study=segment",
        f"model_path={tmp_path / 'model.pt'}",
        f"input={tmp_path / 'in'}",
        f"out={tmp_path / 'out'}",
        "engine=eager",
    ]
    assert main(words) == 0
    assert (tmp_path / "out" / "a.png").is_file() and (tmp_path / "out" / "segmentation.json").is_file()
    assert "frames a second" in capsys.readouterr().out
    (tmp_path / "in" / "b.png").write_bytes(b"no image")
    assert main([*words, "resume=true"]) == 2
    said = capsys.readouterr().out
    assert (
        "Left out: " in said and "b.png: expected an image" in said and "1 masks of the same images" in said
    )
    assert main([*words[:-2], f"out={tmp_path / 'in'}"]) == 2
    assert sorted(path.name for path in (tmp_path / "in").iterdir()) == ["a.png", "b.png"]
