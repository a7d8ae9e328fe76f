"""Names of transforms are read as PLUS means them, also where a frame's name holds "To"."""

from __future__ import annotations

import pytest

from registration.readers.chain.names import resolve, splits


@pytest.mark.parametrize(
    ("name", "pair"),
    [
        ("ProbeToTracker", ("Probe", "Tracker")),
        ("ToolToTracker", ("Tool", "Tracker")),
        ("TestToolToTracker", ("TestTool", "Tracker")),
        ("TorsoToProbe", ("Torso", "Probe")),
        ("ImageToTool", ("Image", "Tool")),
        ("ImageToTorso", ("Image", "Torso")),
        ("ProbeToTOFCamera", ("Probe", "TOFCamera")),
        ("StylusTipTo3DModel", ("StylusTip", "3DModel")),
        ("TotalStationToTopMarker", ("TotalStation", "TopMarker")),
        # Other programs write frames in small letters.
        ("probeTotracker", ("probe", "tracker")),
    ],
)
def test_one_reading(name: str, pair: tuple[str, str]) -> None:
    assert resolve([name]) == {name: pair}


def test_the_other_names_of_a_file_decide_between_readings() -> None:
    assert splits("HandToEyeToWorld") == [("Hand", "EyeToWorld"), ("HandToEye", "World")]
    assert resolve(["HandToEyeToWorld", "ProbeToWorld"])["HandToEyeToWorld"] == ("HandToEye", "World")
    # One settled name settles the next.
    names = ["AToBToC", "AToBToD", "EToC", "ProbeToE"]
    found = resolve(names)
    assert (found["AToBToC"], found["EToC"]) == (("AToB", "C"), ("E", "C"))
    assert found["AToBToD"] == ("AToB", "D")


def test_frames_that_settings_name_decide_before_the_letters() -> None:
    assert resolve(["HandToEyeToWorld"], {"EyeToWorld", "Hand"})["HandToEyeToWorld"] == ("Hand", "EyeToWorld")
    assert resolve(["probeTopToTracker"], {"probe", "pToTracker"})["probeTopToTracker"] == (
        "probe",
        "pToTracker",
    )


def test_what_cannot_be_decided_is_left_out() -> None:
    assert resolve(["AToBToC", "ProbeToTracker", "Probe", "To", "ToTo"]) == {
        "ProbeToTracker": ("Probe", "Tracker")
    }
