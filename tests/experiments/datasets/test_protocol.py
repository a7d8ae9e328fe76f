from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from drawn_vessels import drawn_frames

from experiments.datasets import protocol
from models.labelled_frames import LabelledFrames


def bare() -> LabelledFrames:
    return drawn_frames(4, per_group=1)


@dataclass(frozen=True)
class Talkative:
    name: str = "known"
    root: str = "/data/known"

    def __call__(self) -> LabelledFrames:
        return bare()

    def left_out(self) -> int:
        return 3

    def notes(self) -> list[str]:
        return ["One thing."]

    def test_groups(self) -> list[str]:
        return ["sweep3"]


def test_a_data_set_may_say_nothing_of_itself() -> None:
    protocol.require_root(bare)
    assert protocol.name_of(bare) == "function" and protocol.notes_of(bare) == ()
    assert protocol.label_of(bare, bare()) == "function (simulated)"
    assert protocol.reported_name(bare) == "function"
    assert protocol.outside_groups(bare) == {"selection_groups": (), "test_groups": ()}
    assert protocol.input_data(bare, bare()).source == "simulator"


def test_what_a_data_set_says_is_passed_on() -> None:
    dataset = Talkative()
    assert protocol.name_of(dataset) == "known" and protocol.notes_of(dataset) == ("One thing.",)
    assert protocol.outside_groups(dataset) == {"selection_groups": (), "test_groups": ("sweep3",)}
    assert protocol.reported_name(dataset) == "known (3 unpaired left out)"
    data = protocol.input_data(dataset, bare())
    assert (data.name, data.source, data.digest) == ("known", "/data/known", bare().digest())


def test_notes_of_jobs_are_read_once_each_in_their_order(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("a", "b", "c")]
    for folder, datasets in zip(folders, ([Talkative()], [bare], [Talkative(), Talkative()]), strict=True):
        folder.mkdir()
        protocol.write_notes(folder, *datasets)
    assert not (folders[1] / protocol.NOTES).exists()
    assert protocol.read_notes(folders) == ("One thing.",)
    protocol.write_notes(folders[1], Talkative("other"))
    assert protocol.read_notes(folders) == ("known: One thing.", "other: One thing.")


class WithTables:
    def report(self) -> dict[str, pd.DataFrame]:
        return {
            "pruned": pd.DataFrame([{"case": "a", "rule": "dark"}]),
            "empty": pd.DataFrame(columns=["case", "rule"]),
        }


def test_each_table_is_a_file_and_an_empty_one_keeps_its_columns(tmp_path) -> None:
    assert protocol.write_report(WithTables(), tmp_path) == (tmp_path / "pruned.csv", tmp_path / "empty.csv")
    assert (tmp_path / "pruned.csv").read_text() == "case,rule\na,dark\n"
    assert (tmp_path / "empty.csv").read_text() == "case,rule\n"


def test_a_data_set_that_chooses_nothing_writes_nothing(tmp_path) -> None:
    assert protocol.write_report(object(), tmp_path) == ()
    assert not list(tmp_path.iterdir())
