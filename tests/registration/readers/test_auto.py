"""The reader is chosen by what the path is."""

from __future__ import annotations

from pathlib import Path

import pytest
from plus_sequences import tracked_sequence
from sweeps import assert_same_sweep, known_sweep

from registration.errors import InputError
from registration.readers.auto import AutoReader
from registration.readers.folder import write_folder
from registration.readers.plus.fields import write_sequence
from registration.readers.plus.reader import PlusReader
from registration.readers.plus.sequence import PlusSequence
from registration.readers.plus.writer import write_plus
from registration.readers.rosbag.reader import RosbagReader
from registration.readers.rosbag.writer import write_bag


def test_folder_bag_and_sequence_are_told_apart(tmp_path: Path) -> None:
    write_folder(tmp_path / "folder", known_sweep())
    write_bag(tmp_path / "bag", known_sweep())
    write_plus(tmp_path / "a.igs.nrrd", known_sweep(), max_gap_s=1.0)
    assert_same_sweep(AutoReader()(tmp_path / "folder"), known_sweep())
    assert_same_sweep(AutoReader()(tmp_path / "bag"), known_sweep())
    assert AutoReader()(tmp_path / "a.igs.nrrd").images.shape == known_sweep().images.shape


def test_result_folder_stands_for_the_sweep_in_it(tmp_path: Path) -> None:
    write_folder(tmp_path / "out" / "sweep", known_sweep())
    assert_same_sweep(AutoReader()(tmp_path / "out"), known_sweep())


def test_a_bag_without_metadata_is_one_unless_the_folder_is_a_sweep(tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", known_sweep())
    (tmp_path / "bag" / "metadata.yaml").unlink()
    assert_same_sweep(AutoReader()(tmp_path / "bag"), known_sweep())
    write_folder(tmp_path / "folder", known_sweep(frame_count=3))
    file = next((tmp_path / "bag").glob("*.mcap"))
    (tmp_path / "folder" / "raw.mcap").write_bytes(file.read_bytes())
    assert len(AutoReader()(tmp_path / "folder").images) == 3


@pytest.mark.parametrize(("name", "found"), [("empty", "none of them"), ("absent", "nothing")])
def test_anything_else_is_refused(tmp_path: Path, name: str, found: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=f"{name}: expected a folder with sweep.yaml, .* found {found}"):
        AutoReader()(tmp_path / name)


def test_what_a_reader_advises_names_the_option_that_has_the_setting(tmp_path: Path) -> None:
    """This reader has no setting ``device_set`` itself: it is one of ``acquisition=plus``."""
    sequence = tracked_sequence()
    fields = tuple(
        {key: value for key, value in frame.items() if key != "ImageToProbeTransform"}
        for frame in sequence.frame_fields
    )
    write_sequence(tmp_path / "a.igs.mha", PlusSequence(sequence.pixels, fields))
    with pytest.raises(InputError) as refusal:
        AutoReader()(tmp_path / "a.igs.mha")
    assert str(refusal.value).endswith(
        "(pass acquisition=plus and acquisition.device_set= or acquisition.uncalibrated=)"
    )
    with pytest.raises(InputError) as refusal:
        PlusReader()(tmp_path / "a.igs.mha")
    assert "acquisition=" not in str(refusal.value)


@pytest.mark.parametrize(
    ("message", "end"),
    [
        ("backwards (out_of_order=sort accepts it)", "(pass acquisition=ros2 and acquisition.out_of_order=)"),
        ("a broken bag", "a broken bag"),
    ],
)
def test_advice_is_given_once_also_for_a_result_folder(
    message: str, end: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "out" / "sweep").mkdir(parents=True)
    (tmp_path / "out" / "sweep" / "metadata.yaml").write_text("")

    def refuse(reader: RosbagReader, path: Path) -> None:
        raise InputError(f"{path}: {message}")

    monkeypatch.setattr(RosbagReader, "__call__", refuse)
    with pytest.raises(InputError) as refusal:
        AutoReader()(tmp_path / "out")
    assert str(refusal.value).endswith(end) and str(refusal.value).count("acquisition=") <= 1
