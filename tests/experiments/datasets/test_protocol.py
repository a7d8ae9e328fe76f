from dataclasses import dataclass

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
