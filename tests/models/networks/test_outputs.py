import dataclasses

import pytest
import torch

from models.networks.outputs import SideOutputs


def test_sides_and_presence_are_there_or_not_but_always_named() -> None:
    plain = SideOutputs(torch.zeros(2, 1, 4, 4))
    assert plain.sides == () and plain.presence is None


def test_outputs_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        SideOutputs(torch.zeros(2, 1, 4, 4)).logits = torch.ones(2, 1, 4, 4)


def test_outputs_of_unequal_shapes_are_noticed_where_shapes_are_checked() -> None:
    logits = torch.zeros(2, 1, 4, 4)
    for wrong in ((logits[:1],), (torch.zeros(2, 1, 4, 8),)):
        with pytest.raises(Exception, match="sides"):
            SideOutputs(logits, wrong)
    with pytest.raises(Exception, match="presence"):
        SideOutputs(logits, (), torch.zeros(3))
