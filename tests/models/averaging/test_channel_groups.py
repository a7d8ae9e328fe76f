import numpy as np
import pytest

from models.averaging.channel_groups import ChannelGroups
from models.errors import InputError


def test_united_groups_share_a_root_and_all_restrictions() -> None:
    groups = ChannelGroups()
    a, b, c, d = (groups.new(4) for _ in range(4))
    groups.restrict(a, np.array([0, 0, 0, 1]))
    groups.unite((b,), (c,), "a sum")
    groups.unite((a, d), (c, d), "a sum")
    groups.restrict(b, np.array([5, 6, 6, 6]))
    assert groups.root(a) == groups.root(b) == groups.root(c) != groups.root(d)
    # Only the second and third channel are alike in both restrictions.
    assert groups.blocks(c).tolist() == [0, 1, 1, 2]
    assert groups.blocks(d).tolist() == [0, 0, 0, 0]


def test_refuses_to_unite_groups_of_other_sizes() -> None:
    groups = ChannelGroups()
    a, b, c = groups.new(2), groups.new(4), groups.new(6)
    with pytest.raises(
        InputError, match=r"joined in add to be grouped alike, found groups of \[2, 4\] and \[6\]"
    ):
        groups.unite((a, b), (c,), "add")
