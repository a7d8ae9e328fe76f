"""Chains of named transforms against products written out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from sweeps import CALIBRATION, world_T_ee

from registration.errors import InputError
from registration.readers.chain.graph import TransformGraph

A_T_B, A_T_C, D_T_C = world_T_ee(np.array([1.0, 2.0, 3.0]))
GRAPH = TransformGraph(
    {("B", "A"): A_T_B, ("C", "A"): A_T_C, ("C", "D"): D_T_C, ("P", "B"): CALIBRATION.probe_A_pixel}
)


def test_chain_forwards_backwards_and_affine() -> None:
    np.testing.assert_allclose(GRAPH.chain("B", "A"), A_T_B)
    np.testing.assert_allclose(GRAPH.chain("A", "B"), np.linalg.inv(A_T_B))
    expected = D_T_C @ np.linalg.inv(A_T_C) @ A_T_B @ CALIBRATION.probe_A_pixel
    np.testing.assert_allclose(GRAPH.chain("P", "D"), expected, atol=1e-12)
    np.testing.assert_allclose(GRAPH.chain("D", "P") @ expected, np.eye(4), atol=1e-9)


def test_stack_in_a_chain_gives_a_stack() -> None:
    stack = world_T_ee(np.array([0.0, 0.5]))
    found = GRAPH.joined(TransformGraph({("A", "W"): stack})).chain("C", "W")
    np.testing.assert_allclose(found, stack @ A_T_C, atol=1e-12)


def test_own_transform_counts_before_a_joined_one() -> None:
    np.testing.assert_allclose(GRAPH.joined(TransformGraph({("B", "A"): np.eye(4)})).chain("B", "A"), A_T_B)


def test_shortest_chain_is_taken() -> None:
    direct = GRAPH.joined(TransformGraph({("P", "D"): np.eye(4)}))
    np.testing.assert_array_equal(direct.chain("P", "D"), np.eye(4))


def test_frame_to_itself_is_the_identity() -> None:
    np.testing.assert_array_equal(GRAPH.chain("B", "B"), np.eye(4))


def test_unlinked_frames_are_refused_with_what_is_known() -> None:
    with pytest.raises(
        InputError, match="transform BToZ: expected a chain of known transforms, found BToA, CToA"
    ):
        GRAPH.chain("B", "Z")


def test_matrix_without_inverse_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="XToYTransform: expected an invertible matrix"):
        TransformGraph({("X", "Y"): np.array([np.diag([1.0, 0, 1, 1])])})
