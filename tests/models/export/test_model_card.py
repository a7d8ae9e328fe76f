import dataclasses

import torch

from models.calibration.temperature import TemperatureScaling
from models.export.model_card import model_card
from models.model_file import ModelMember, SegmentationModel
from models.networks.unet import UNet
from models.postprocessing.hysteresis import Hysteresis
from models.postprocessing.morphology import Morphology
from models.postprocessing.options import Option
from models.preprocessing.preprocessing import Preprocessing


def full() -> SegmentationModel:
    torch.manual_seed(0)
    recipe = UNet(width=2, depth=2)
    members = tuple(ModelMember(f"fold {index}", recipe, recipe().state_dict()) for index in range(2))
    return SegmentationModel(
        members,
        Preprocessing(32),
        TemperatureScaling(1.25, -0.5),
        Option(Hysteresis(0.3, 0.6), Morphology(min_area_mm2=4.0)),
        min_presence=0.4,
        certificate={"verdict": "ensemble", "margin": {"dsc": 0.01}, "groups": ["a", "b"]},
        data={
            "usgra": {"licence": "CC BY 4.0", "digest": "ab12", "groups": 7},
            "phantom": {"digest": "cd34", "simulated": True},
        },
        notes={"scores": {"test": {"dsc": 0.7213, "hd95_px": 12.0}, "out of fold": {"dsc": 0.66}}},
    )


def test_a_card_says_all_that_the_file_knows() -> None:
    model = full()
    card = model_card(model, "Radial artery")
    for text in (
        "# Radial artery",
        "an ensemble of 2 networks",
        f"`{model.digest}`",
        "| usgra | CC BY 4.0 | ab12 | 7 |",
        "| phantom | not recorded | cd34 | not recorded | yes |",
        "- verdict: ensemble",
        "- margin, dsc: 0.01",
        "- groups: a, b",
        "temperature 1.25, bias -0.5",
        "low 0.3, high 0.6",
        "min_area_mm2 4",
        "presence of at least 0.4",
        "| test | 0.7213 | 12 |",
        "| out of fold | 0.66 |  |",
        "Some of the data were simulated.",
        "frames need a known pixel size",
    ):
        assert text in card, text
    assert "no certificate" not in card and "not calibrated" not in card


def test_a_card_says_what_nobody_knows() -> None:
    bare = dataclasses.replace(
        full(), calibration=None, postprocessing=None, min_presence=None, certificate={}, data={}, notes={}
    )
    card = model_card(dataclasses.replace(bare, members=bare.members[:1]), "A")
    for text in (
        "one network",
        "Which data the model was trained on is not recorded.",
        "None: nobody has recorded",
        "- calibration: none",
        "- thresholds: 0.5",
        "No score is recorded",
        "treat every mask as untested",
        "not calibrated",
        "no medical device",
    ):
        assert text in card, text


def test_plain_scores_are_a_table_of_two_columns() -> None:
    card = model_card(dataclasses.replace(full(), notes={"scores": {"dsc": 0.5, "false|alarms": 3}}), "A")
    assert "| dsc | 0.5 |" in card and "| false\\|alarms | 3 |" in card
