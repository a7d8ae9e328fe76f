from pathlib import Path

import numpy as np
import pytest
import torch

from experiments.errors import InputError
from experiments.tracking import Store
from experiments.tracking.model_registry import register_model
from models.model_file import ModelMember, SegmentationModel
from models.networks.unet import UNet
from models.predictor import Predictor
from models.preprocessing.preprocessing import Preprocessing


def test_a_registered_model_gives_the_masks_of_its_file(home: Path, tmp_path: Path) -> None:
    import mlflow.pyfunc

    torch.manual_seed(0)
    recipe = UNet(width=2, depth=2, normalisation="none")
    model = SegmentationModel(
        (ModelMember("a", recipe, recipe().state_dict()),),
        Preprocessing(16),
        certificate={"verdict": "single"},
    )
    model.save(tmp_path / "model.pt")
    store = Store()
    assert register_model(store, "vessels", tmp_path / "model.pt", model) == 1
    assert register_model(store, "vessels", tmp_path / "model.pt", model) == 2
    version = store.client().get_model_version("vessels", "2")
    assert version.tags["digest"] == model.digest
    assert store.run(version.run_id).info.status == "FINISHED"
    loaded = mlflow.pyfunc.load_model(store.client().get_model_version_download_uri("vessels", "2"))
    assert [spec.name for spec in loaded.metadata.signature.inputs] == ["frames"]
    assert loaded.metadata.metadata["certificate"] == {"verdict": "single"}
    assert loaded.input_example["frames"].shape == (1, 16, 16)
    frames = np.random.default_rng(0).integers(0, 256, (2, 20, 24), dtype=np.uint8)
    np.testing.assert_array_equal(
        loaded.predict({"frames": frames}), Predictor.load(tmp_path / "model.pt")(frames)
    )


def test_a_name_that_the_tracker_does_not_take_is_refused(home: Path, tmp_path: Path) -> None:
    recipe = UNet(width=2, depth=2)
    model = SegmentationModel((ModelMember("a", recipe, recipe().state_dict()),), Preprocessing(16))
    model.save(tmp_path / "model.pt")
    with pytest.raises(
        InputError, match=r"register_as: expected a name that the tracker takes, received 'a/b:c'"
    ):
        register_model(Store(), "a/b:c", tmp_path / "model.pt", model)
