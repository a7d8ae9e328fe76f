from dataclasses import dataclass

from drawn_vessels import drawn_frames

from experiments.datasets import about
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
    about.require_root(bare)
    assert about.name_of(bare) == "function" and about.notes_of(bare) == ()
    assert about.label_of(bare, bare()) == "function (simulated)"
    assert about.reported_name(bare) == "function"
    assert about.outside_groups(bare) == {"selection_groups": (), "test_groups": ()}
    assert about.input_data(bare, bare()).source == "simulator"


def test_what_a_data_set_says_is_passed_on() -> None:
    dataset = Talkative()
    assert about.name_of(dataset) == "known" and about.notes_of(dataset) == ("One thing.",)
    assert about.outside_groups(dataset) == {"selection_groups": (), "test_groups": ("sweep3",)}
    assert about.reported_name(dataset) == "known (3 unpaired left out)"
    data = about.input_data(dataset, bare())
    assert (data.name, data.source, data.digest) == ("known", "/data/known", bare().digest())
