import numpy as np
import pytest

from models.errors import InputError
from models.postprocessing import components
from models.postprocessing.components import bounding_box, require_connectivity


def test_components_over_edges_and_over_corners() -> None:
    mask = np.array([[0, 0, 0, 0, 0], [0, 1, 0, 0, 1], [0, 0, 1, 1, 0]], bool)
    edges, corners = components(mask, 1), components(mask, 2)
    assert edges.count == 3 and corners.count == 1
    assert edges.box == (slice(1, 3), slice(1, 5))
    # By their first pixels, row by row.
    assert edges.labels.tolist() == [[1, 0, 0, 2], [0, 3, 3, 0]]
    assert edges.areas.tolist() == [4, 1, 1, 2]


def test_an_empty_mask_has_an_empty_box() -> None:
    found = components(np.zeros((3, 4), bool), 1)
    assert found.count == 0 and found.labels.size == 0 and found.areas.tolist() == [0]
    assert bounding_box(np.zeros((3, 4), bool)) == (slice(0, 0), slice(0, 0))


def test_refuses_other_connectivities() -> None:
    for connectivity in (0, 4, 8):
        with pytest.raises(InputError, match=r"connectivity: expected 1 \(edges\) or 2"):
            require_connectivity(connectivity)
