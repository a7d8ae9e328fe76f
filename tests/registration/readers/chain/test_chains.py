"""Which of several chains of transforms counts, against products written out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from sweeps import CALIBRATION, world_T_ee

from registration.errors import InputError
from registration.readers.chain.chains import Link, calibration_order, chains, links_from, pose_order

TRACKER_T_PROBE = world_T_ee(np.array([0.0, 0.4, 0.9]))
REFERENCE_T_TRACKER = world_T_ee(np.array([7.0]))[0]
OLD = CALIBRATION.probe_A_pixel
NEW = world_T_ee(np.array([3.0]))[0] @ OLD
MARKER_T_PROBE = world_T_ee(np.array([2.0]))[0]
ALL = np.ones(3, dtype=bool)


def names(chain: object) -> list[str]:
    return [link.name for link in chain.links]  # type: ignore[attr-defined]


def test_a_chain_forwards_backwards_and_of_stacks() -> None:
    links = links_from(
        {("Probe", "Tracker"): (TRACKER_T_PROBE, ALL)}, {("Reference", "Tracker"): REFERENCE_T_TRACKER}
    )
    (only,) = chains(links, "Probe", "Reference", pose_order)
    np.testing.assert_allclose(only.matrix, np.linalg.inv(REFERENCE_T_TRACKER) @ TRACKER_T_PROBE, atol=1e-9)


def test_a_named_calibration_comes_before_a_shorter_chain_of_the_recording() -> None:
    recorded = {("Image", "Probe"): (np.tile(OLD, (3, 1, 1)), ALL)}
    given = {("Image", "Marker"): NEW, ("Marker", "Probe"): MARKER_T_PROBE}
    best, other = chains(links_from(recorded, given), "Image", "Probe", calibration_order)
    assert (names(best), names(other)) == (["ImageToMarker", "MarkerToProbe"], ["ImageToProbe"])
    np.testing.assert_allclose(best.matrix, MARKER_T_PROBE @ NEW, atol=1e-9)


def test_a_named_link_counts_also_where_the_recording_has_to_complete_it() -> None:
    recorded = {
        ("Image", "Probe"): (np.tile(OLD, (3, 1, 1)), ALL),
        ("Marker", "Holder"): (np.tile(np.eye(4), (3, 1, 1)), ALL),
        ("Holder", "Probe"): (np.tile(MARKER_T_PROBE, (3, 1, 1)), ALL),
    }
    best = chains(links_from(recorded, {("Image", "Marker"): NEW}), "Image", "Probe", calibration_order)[0]
    assert names(best) == ["ImageToMarker", "MarkerToHolder", "HolderToProbe"]


def test_a_named_transform_comes_before_the_same_one_in_the_recording_either_way_round() -> None:
    recorded = {("Probe", "Image"): (np.tile(np.linalg.inv(OLD), (3, 1, 1)), ALL)}
    found = chains(links_from(recorded, {("Image", "Probe"): NEW}), "Image", "Probe", calibration_order)
    np.testing.assert_array_equal(found[0].matrix, NEW)
    assert len(found) == 2


def test_no_constant_replaces_a_tracked_pose() -> None:
    recorded = {("Probe", "Tracker"): (TRACKER_T_PROBE, ALL)}
    best = chains(
        links_from(recorded, {("Probe", "Tracker"): REFERENCE_T_TRACKER}), "Probe", "Tracker", pose_order
    )[0]
    np.testing.assert_array_equal(best.matrix, TRACKER_T_PROBE)
    still = {("Probe", "Tracker"): (np.tile(OLD, (3, 1, 1)), ALL)}
    best = chains(
        links_from(still, {("Probe", "Tracker"): REFERENCE_T_TRACKER}), "Probe", "Tracker", pose_order
    )[0]
    np.testing.assert_array_equal(best.matrix, REFERENCE_T_TRACKER)


def test_a_chain_that_is_valid_nowhere_comes_last() -> None:
    recorded = {
        ("Probe", "Reference"): (TRACKER_T_PROBE, ~ALL),
        ("Probe", "Tracker"): (TRACKER_T_PROBE, ALL),
        ("Reference", "Tracker"): (TRACKER_T_PROBE[::-1], ALL),
    }
    best, other = chains(links_from(recorded, {}), "Probe", "Reference", pose_order)
    assert names(best) == ["ProbeToTracker", "ReferenceToTracker"]
    assert other.dead


def test_a_matrix_without_inverse_matters_only_on_the_chain() -> None:
    links = links_from({}, {("Probe", "Tracker"): np.eye(4), ("Stylus", "Tracker"): np.zeros((4, 4))})
    np.testing.assert_array_equal(chains(links, "Probe", "Tracker", pose_order)[0].matrix, np.eye(4))
    with pytest.raises(InputError, match="StylusToTrackerTransform: expected last row"):
        _ = chains(links, "Stylus", "Tracker", pose_order)[0].matrix


def test_unlinked_and_entangled_frames_are_refused() -> None:
    with pytest.raises(
        InputError, match="transform ProbeToWorld: expected a chain of known transforms, found AToB"
    ):
        chains([Link("A", "B", np.eye(4))], "Probe", "World", pose_order)
    everything = [
        Link(str(a), str(b), np.eye(4)) for a in range(12) for b in range(12) if a < b and (a, b) != (0, 11)
    ]
    with pytest.raises(
        InputError, match="transform 0To11: expected a few chains of transforms, found more than"
    ):
        chains(everything, "0", "11", pose_order)
