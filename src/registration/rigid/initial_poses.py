"""Starting poses for a rigid search: principal axes laid on each other, rolled, inverted and slid along the vessel."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from registration import transforms
from registration.geometry.shapes import LINE_SHARE, PrincipalFrame, principal_frame
from registration.rigid.icp.correspondence import TreeTarget
from registration.rigid.icp.loop import align
from registration.rigid.pose_comparison import distinct

# Below this share of the moving cloud's length there is no room to slide: the whole is one window.
NO_ROOM_SHARE = 0.05
# A window with fewer points than this has no principal axes worth laying anything on.
WINDOW_POINTS = 10
# A sliver of a long vessel would otherwise ask for more starts than anyone waits for.
MAX_WINDOWS = 40
# Places of a centerline that move it alike within this share of its radius are one.
SAME_PLACE_SHARE = 0.1
# Centerlines are smoothed over this share of their extent: the way along jagged points would be too long.
REACH_SHARE = 1 / 20
# A sparse matrix takes a distance of 0 for no connection.
TOUCHING_MM = 1e-9


def symmetry_starts(
    moving_mm: Float64[np.ndarray, "m 3"],
    fixed_mm: Float64[np.ndarray, "n 3"],
    rolls: int,
    slide_share: float,
    axis_share: float,
    compact_share: float = 1.0,
    *,
    invert: bool = True,
    slide: bool = True,
) -> Float64[np.ndarray, "s 4 4"]:
    """Compute every start worth trying without prior knowledge.

    The principal axis of the moving cloud is laid on that of a window of the fixed one, both ways round, and rolled
    about it. The windows are as long as the moving cloud and slide along the fixed one: the axes of a piece are
    those of the same piece of the whole, not those of the whole. A moving cloud as long as the fixed one has one
    window.

    A short piece with a bifurcation is as wide as it is long, and noise and the way it is cut decide which axis comes
    first: the axes that ``principal_axes`` names are therefore taken for the principal one in turn, and windows slide
    along those of the fixed cloud that it names, so that all are tried of shapes without a principal axis.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    fixed_mm : ndarray, shape (n, 3)
        Fixed points in mm.
    rolls : int
        Number of equal steps of rotation about the axis.
    slide_share : float
        Largest step along the fixed cloud as a share of the moving one's length; there are 40 windows at most.
    axis_share : float
        An axis with this share of the longest spread counts as principal too.
    compact_share : float, optional
        Where the second axis has this share of the first one's spread, none is principal; 1 turns that rule off.
    invert : bool, optional
        Whether the vessel is tried the other way round as well.
    slide : bool, optional
        Whether windows slide; if not, the whole is one.

    Returns
    -------
    ndarray, shape (s, 4, 4)
        Starting poses (fixed_T_moving).
    """
    moving, fixed = principal_frame(moving_mm), principal_frame(fixed_mm)
    local = _turns(rolls, invert)
    # Of a fixed cloud as long as it is wide any axis may be the vessel's; one that is clearly longer has one.
    ways = principal_axes(fixed.spread_mm, 1.0, compact_share)
    starts = []
    for first in principal_axes(moving.spread_mm, axis_share, compact_share):
        axes = np.roll(moving.axes, -first, axis=1)
        length_mm = float(np.ptp((moving_mm - moving.centre_mm) @ axes[:, 0]))
        windows = [
            window for way in ways for window in _windows(fixed_mm, fixed, way, length_mm, slide_share)
        ]
        # Without room to slide, the whole is one window whichever way.
        windows = list({id(window): window for window in windows}.values()) if slide else [fixed]
        starts += [_laid(moving.centre_mm, axes, window, local) for window in windows]
    return np.concatenate(starts)


def principal_axes(
    spread_mm: Float64[np.ndarray, "3"], axis_share: float, compact_share: float
) -> tuple[int, ...]:
    """Find which of a shape's axes may be a vessel's.

    Parameters
    ----------
    spread_mm : ndarray, shape (3,)
        Spread along each axis in mm, longest first.
    axis_share : float
        An axis with at least this share of the first one's spread may be the vessel's.
    compact_share : float
        Where the second axis has at least this share of the first one's spread, none is principal and all three may
        be; 1 turns that rule off.

    Returns
    -------
    tuple of int
        Indices of the axes.
    """
    if compact_share < 1 and spread_mm[1] >= compact_share * spread_mm[0]:
        return 0, 1, 2
    return tuple(int(axis) for axis in np.flatnonzero(spread_mm >= axis_share * spread_mm[0]))


def centerline_starts(
    moving_mm: Float64[np.ndarray, "p 3"],
    fixed_mm: Float64[np.ndarray, "q 3"],
    rolls: int,
    slide_share: float,
    places: int,
    *,
    invert: bool = True,
    slide: bool = True,
) -> Float64[np.ndarray, "s 4 4"]:
    """Compute starts for the surfaces from ICP on their centerlines: its best places, rolled about the vessel.

    Slides are steps along the fixed centerline's arc length: a window holds the points within half the moving
    centerline's length of its middle, measured along the lines, so that both limbs of an arch are never in one. A
    straight centerline leaves the roll open, a symmetric one the inversion: every place is rolled.

    Parameters
    ----------
    moving_mm : ndarray, shape (p, 3)
        Points on the moving centerline in mm.
    fixed_mm : ndarray, shape (q, 3)
        Points on the fixed centerline in mm.
    rolls : int
        Number of equal steps of rotation about the axis.
    slide_share : float
        Step along the fixed centerline as a share of the moving one's length.
    places : int
        Number of best places that are rolled.
    invert : bool, optional
        Whether the vessel is tried the other way round as well.
    slide : bool, optional
        Whether windows slide; if not, the whole is one.

    Returns
    -------
    ndarray, shape (s, 4, 4)
        Starting poses (fixed_T_moving).
    """
    moving = principal_frame(moving_mm)
    local = _turns(rolls, invert)
    length_mm = arc_length_mm(moving_mm)
    windows = arc_windows(fixed_mm, length_mm, slide_share) if slide else [principal_frame(fixed_mm)]
    starts = [_laid(moving.centre_mm, moving.axes, window, local) for window in windows]
    found = align(
        moving_mm, TreeTarget(fixed_mm), np.concatenate(starts), keep=0.9, max_iterations=30, tolerance=1e-3
    )
    order = np.argsort(found.rmse_mm, kind="stable")
    reach_mm = SAME_PLACE_SHARE * float(np.sqrt(moving_mm.var(axis=0).sum()))
    groups = distinct(found.fixed_T_moving[order], moving_mm, reach_mm)[:places]
    rolled = Rotation.from_matrix(moving.axes @ local[:rolls] @ moving.axes.T)
    about = transforms.from_rotation(rolled, moving.centre_mm - rolled.apply(moving.centre_mm))
    return np.concatenate([found.fixed_T_moving[order[group[0]]] @ about for group in groups])


def cone_starts(
    moving_mm: Float64[np.ndarray, "m 3"],
    initial: Float64[np.ndarray, "4 4"],
    angle_deg: float,
    radius_mm: float,
) -> Float64[np.ndarray, "s 4 4"]:
    """Compute starts around a known pose: turned about each principal axis of the moving cloud, slid along the first.

    Turns are by half and by all of the angle, both ways; slides likewise.

    Parameters
    ----------
    moving_mm : ndarray, shape (m, 3)
        Moving points in mm.
    initial : ndarray, shape (4, 4)
        Known pose (fixed_T_moving).
    angle_deg : float
        Largest turn in degrees.
    radius_mm : float
        Largest slide in mm; at most half the cloud's length is used.

    Returns
    -------
    ndarray, shape (s, 4, 4)
        Starting poses (fixed_T_moving), the known one first.
    """
    moving = principal_frame(moving_mm)
    angles = np.deg2rad(angle_deg) * np.array([-1.0, -0.5, 0.5, 1.0])
    rotations = Rotation.from_rotvec(
        np.concatenate([np.zeros((1, 3)), (angles[:, None, None] * moving.axes.T[None]).reshape(-1, 3)])
    )
    turned = transforms.from_rotation(rotations, moving.centre_mm - rotations.apply(moving.centre_mm))
    farthest_mm = min(radius_mm, 0.5 * float(np.ptp((moving_mm - moving.centre_mm) @ moving.axes[:, 0])))
    slid = np.tile(np.eye(4), (5, 1, 1))
    slid[:, :3, 3] = farthest_mm * np.array([0.0, -1.0, -0.5, 0.5, 1.0])[:, None] * moving.axes[:, 0]
    return (initial @ slid[:, None] @ turned[None]).reshape(-1, 4, 4)


def arc_length_mm(points_mm: Float64[np.ndarray, "p 3"]) -> float:
    """Compute the longest way along the lines that points lie on.

    Parameters
    ----------
    points_mm : ndarray, shape (p, 3)
        Points on lines in mm.

    Returns
    -------
    float
        Length in mm.
    """
    tree = _spanning(_smoothed(points_mm))
    first = dijkstra(tree, directed=False, indices=0)
    return float(dijkstra(tree, directed=False, indices=int(first.argmax())).max())


def arc_windows(
    points_mm: Float64[np.ndarray, "p 3"], length_mm: float, slide_share: float
) -> list[PrincipalFrame]:
    """Compute the principal axes of pieces of a centerline.

    Parameters
    ----------
    points_mm : ndarray, shape (p, 3)
        Points on the centerline in mm.
    length_mm : float
        Length of a piece along the lines in mm.
    slide_share : float
        Step between pieces as a share of that length.

    Returns
    -------
    list of PrincipalFrame
        Principal axes of each piece; those of the whole where it is hardly longer than a piece.
    """
    points_mm = _smoothed(points_mm)
    tree = _spanning(points_mm)
    half_mm = 0.5 * length_mm
    whole = principal_frame(points_mm)
    ends = dijkstra(tree, directed=False, indices=int(dijkstra(tree, directed=False, indices=0).argmax()))
    if ends.max() <= (1 + NO_ROOM_SHARE) * length_mm:
        return [whole]
    away_mm = np.full(len(points_mm), np.inf)
    # The first middle is where a window just fits at one end; the next is always the point farthest from all so far.
    pick = int(np.abs(ends - half_mm).argmin())
    windows = []
    for _ in range(MAX_WINDOWS):
        reached_mm = dijkstra(tree, directed=False, indices=pick)
        inside = reached_mm <= half_mm
        # A middle too close to an end has half a window: the others hold its points already.
        if inside.sum() >= WINDOW_POINTS and np.ptp(ends[inside]) >= 0.6 * length_mm:
            windows.append(principal_frame(points_mm[inside]))
        away_mm = np.minimum(away_mm, reached_mm)
        pick = int(away_mm.argmax())
        if away_mm[pick] <= slide_share * length_mm:
            break
    return windows or [whole]


def _smoothed(points_mm: np.ndarray) -> np.ndarray:
    """Each point brought to the mean of those around it."""
    reach_mm = REACH_SHARE * float(np.ptp(points_mm, axis=0).max())
    near = (cdist(points_mm, points_mm) <= reach_mm).astype(np.float64)
    return near @ points_mm / near.sum(axis=1, keepdims=True)


def _spanning(points_mm: np.ndarray) -> csr_matrix:
    """The shortest tree that connects all points: along the lines, and once across wherever two meet."""
    return minimum_spanning_tree(csr_matrix(cdist(points_mm, points_mm) + TOUCHING_MM))


def _turns(rolls: int, invert: bool) -> np.ndarray:
    """Rolls about the first axis in equal steps, then the same with that axis inverted if asked."""
    turns = Rotation.from_rotvec(np.arange(rolls)[:, None] * [2 * np.pi / rolls, 0.0, 0.0])
    inverted = turns * Rotation.from_rotvec([0.0, np.pi, 0.0])
    return np.concatenate([turns.as_matrix(), inverted.as_matrix()]) if invert else turns.as_matrix()


def _laid(centre_mm: np.ndarray, axes: np.ndarray, window: PrincipalFrame, local: np.ndarray) -> np.ndarray:
    """The moving cloud's axes laid on those of a window, turned by each of the local rotations."""
    rotation = Rotation.from_matrix(window.axes @ local @ axes.T)
    return transforms.from_rotation(rotation, window.centre_mm - rotation.apply(centre_mm))


def _windows(
    fixed_mm: Float64[np.ndarray, "n 3"],
    whole: PrincipalFrame,
    way: int,
    length_mm: float,
    slide_share: float,
) -> list[PrincipalFrame]:
    """Pieces of the fixed cloud ``length_mm`` long, at steps of a share of it along one of its axes."""
    along_mm = (fixed_mm - whole.centre_mm) @ whole.axes[:, way]
    first_mm, last_mm = float(along_mm.min()), float(along_mm.max())
    room_mm = last_mm - first_mm - length_mm
    # Along the normal of a flat piece there is no length that a window could have.
    if room_mm <= NO_ROOM_SHARE * length_mm or length_mm <= LINE_SHARE * (last_mm - first_mm):
        return [whole]
    count = min(1 + int(np.ceil(room_mm / (slide_share * length_mm))), MAX_WINDOWS)
    windows = []
    for middle_mm in np.linspace(first_mm + length_mm / 2, last_mm - length_mm / 2, count):
        inside = np.abs(along_mm - middle_mm) <= length_mm / 2
        if inside.sum() >= WINDOW_POINTS:
            windows.append(principal_frame(fixed_mm[inside]))
    return windows or [whole]
