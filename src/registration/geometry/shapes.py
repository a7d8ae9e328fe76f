"""Triangle meshes, centerlines and the shape of a point cloud, as the rest of the package passes them around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from numpy.typing import ArrayLike

from registration import transforms
from registration.brief import brief_repr
from registration.errors import InputError

# A cloud whose second principal spread is below this share of its first is a line (or a point) for every purpose
# here: no rotation about it can be determined from its points. Single-precision files resolve about 1e-7.
LINE_SHARE = 1e-6
# A cloud whose bounding box is smaller than this was not measured in millimetres.
METRES_BELOW_MM = 2.0


@dataclass(frozen=True)
class Mesh:
    """A surface of triangles.

    Parameters
    ----------
    vertices_mm : ndarray, shape (v, 3)
        Vertices in mm.
    triangles : ndarray, shape (t, 3)
        Indices of each triangle's corners, wound so that normals point out.
    """

    vertices_mm: Float64[np.ndarray, "v 3"]
    triangles: Int64[np.ndarray, "t 3"]

    __repr__ = brief_repr

    def __post_init__(self) -> None:
        if not np.isfinite(self.vertices_mm).all():
            raise InputError("vertices_mm: expected finite coordinates, received NaN or infinity")
        if len(self.triangles) and not (
            0 <= self.triangles.min() and self.triangles.max() < len(self.vertices_mm)
        ):
            raise InputError(
                f"triangles: expected indices from 0 to {len(self.vertices_mm) - 1}, "
                f"received {self.triangles.min()} to {self.triangles.max()}"
            )

    def _repr_html_(self) -> str:
        from registration.geometry.pictures import surface_picture

        return surface_picture(
            f"{len(self.vertices_mm)} vertices, {len(self.triangles)} triangles", self.vertices_mm
        )

    @property
    def corners_mm(self) -> Float64[np.ndarray, "t 3 3"]:
        """The three corners of every triangle."""
        return self.vertices_mm[self.triangles]

    @property
    def areas_mm2(self) -> Float64[np.ndarray, " t"]:
        """The area of every triangle."""
        a, b, c = np.moveaxis(self.corners_mm, 1, 0)
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)

    def sample(self, count: int, rng: np.random.Generator) -> Float64[np.ndarray, "count 3"]:
        """Draw points uniformly by area, by square-root barycentric coordinates.

        Parameters
        ----------
        count : int
            Number of points.
        rng : numpy.random.Generator
            Source of random numbers.

        Returns
        -------
        ndarray, shape (count, 3)
            Points on the triangles in mm.

        Raises
        ------
        InputError
            If no triangle has an area.

        References
        ----------
        R. Osada et al., ACM Trans. Graph. 21(4), 2002.
        """
        areas_mm2 = self.areas_mm2
        if not areas_mm2.sum() > 0:
            raise InputError("mesh: expected a surface with area to sample, received none")
        chosen = rng.choice(len(areas_mm2), size=count, p=areas_mm2 / areas_mm2.sum())
        root, along = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
        a, b, c = np.moveaxis(self.corners_mm[chosen], 1, 0)
        return (1 - root) * a + root * (1 - along) * b + root * along * c


# What is registered: a mesh, or the points of a cloud (n, 3) in mm.
Surface = Mesh | Float64[np.ndarray, "_ 3"]


def transformed(surface: Surface, A_T_B: Float64[np.ndarray, "4 4"]) -> Surface:
    """Transform a surface into another coordinate frame.

    Parameters
    ----------
    surface : Surface
        Mesh or points in frame B in mm.
    A_T_B : ndarray, shape (4, 4)
        Rigid transform from frame B to A.

    Returns
    -------
    Surface
        The same mesh or points in frame A.
    """
    return with_points(surface, transforms.apply(A_T_B, points_of(surface)))


def points_of(surface: Surface) -> Float64[np.ndarray, "n 3"]:
    """Return the vertices of a mesh, or the points of a cloud.

    Parameters
    ----------
    surface : Surface
        The surface.

    Returns
    -------
    ndarray, shape (n, 3)
        Points in mm.
    """
    return surface.vertices_mm if isinstance(surface, Mesh) else surface


def with_points(surface: Surface, points_mm: Float64[np.ndarray, "n 3"]) -> Surface:
    """Put other points in place of a surface's own.

    Parameters
    ----------
    surface : Surface
        Mesh or points.
    points_mm : ndarray, shape (n, 3)
        A point in mm for each of its points.

    Returns
    -------
    Surface
        Mesh with the same triangles, or the points.
    """
    return Mesh(points_mm, surface.triangles) if isinstance(surface, Mesh) else points_mm


def sampled(surface: Surface, count: int, rng: np.random.Generator) -> Float64[np.ndarray, "n 3"]:
    """Draw points on a mesh uniformly by area; the points of a cloud are taken as they are.

    Parameters
    ----------
    surface : Surface
        Mesh or points in mm.
    count : int
        Number of points on a mesh.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    ndarray, shape (n, 3)
        Points in mm.
    """
    return surface.sample(count, rng) if isinstance(surface, Mesh) else surface


@dataclass(frozen=True)
class Polyline:
    """One line of a centerline.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Ordered points in mm, at least two.
    radius_mm : ndarray, shape (n,)
        Radius of the vessel at each point in mm.

    Raises
    ------
    InputError
        If there are fewer than two points, not as many radii, or numbers that are not finite.
    """

    points_mm: Float64[np.ndarray, "n 3"]
    radius_mm: Float64[np.ndarray, " n"]

    __repr__ = brief_repr

    def __post_init__(self) -> None:
        if len(self.points_mm) < 2:
            raise InputError(f"points_mm: expected at least 2 points a line, received {len(self.points_mm)}")
        if not np.isfinite(self.points_mm).all():
            raise InputError("points_mm: expected finite coordinates, received NaN or infinity")
        if not (np.isfinite(self.radius_mm).all() and (self.radius_mm >= 0).all()):
            raise InputError("radius_mm: expected finite radii of at least 0, received others")

    @property
    def arc_mm(self) -> Float64[np.ndarray, " n"]:
        """Arc length from the first point to each."""
        steps_mm = np.linalg.norm(np.diff(self.points_mm, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps_mm)])

    @property
    def length_mm(self) -> float:
        """Arc length from the first point to the last."""
        return float(self.arc_mm[-1])

    def at(self, arc_mm: Float64[np.ndarray, " k"]) -> Float64[np.ndarray, "k 3"]:
        """Find the points at given arc lengths, linear between neighbours.

        Parameters
        ----------
        arc_mm : ndarray, shape (k,)
            Arc lengths from the first point in mm.

        Returns
        -------
        ndarray, shape (k, 3)
            Points in mm.
        """
        own_mm = self.arc_mm
        return np.stack([np.interp(arc_mm, own_mm, self.points_mm[:, axis]) for axis in range(3)], axis=1)


@dataclass(frozen=True)
class Centerline:
    """The centerline of a vessel tree.

    Parameters
    ----------
    lines : tuple of Polyline
        At least one line, each branch a line of its own; lines may share a trunk.

    Raises
    ------
    InputError
        If there is no line.
    """

    lines: tuple[Polyline, ...]

    __repr__ = brief_repr

    def __post_init__(self) -> None:
        if not self.lines:
            raise InputError("lines: expected at least one line, received none")

    @property
    def length_mm(self) -> float:
        """Sum of the lines' arc lengths."""
        return float(sum(line.length_mm for line in self.lines))

    def transformed(self, A_T_B: Float64[np.ndarray, "4 4"]) -> Centerline:
        """Transform the lines into another coordinate frame.

        Parameters
        ----------
        A_T_B : ndarray, shape (4, 4)
            Rigid transform from this centerline's frame B to A.

        Returns
        -------
        Centerline
            The same lines in frame A, with the same radii.
        """
        return Centerline(
            tuple(Polyline(transforms.apply(A_T_B, line.points_mm), line.radius_mm) for line in self.lines)
        )

    def even_points(self, max_points: int) -> Float64[np.ndarray, "k 3"]:
        """Place points at even arc length, both ends of each line included.

        A stretch that several lines share is sampled once: a point closer than half a step to one of an
        earlier line is left out, so that the trunk does not weigh more than the branches.

        Parameters
        ----------
        max_points : int
            Largest number of points, at least two for each line.

        Returns
        -------
        ndarray, shape (k, 3)
            Points in mm.

        Raises
        ------
        InputError
            If ``max_points`` is too small for both ends of each line.
        """
        if max_points < 2 * len(self.lines):
            raise InputError(
                f"max_points: expected at least {2 * len(self.lines)} (both ends of each line), "
                f"received {max_points}"
            )
        step_mm = self.length_mm / (max_points - len(self.lines)) if self.length_mm > 0 else 1.0
        kept: Float64[np.ndarray, "k 3"] = np.empty((0, 3))
        for line in self.lines:
            count = int(np.floor(line.length_mm / step_mm + 1e-9)) + 1
            points_mm = line.at(np.linspace(0.0, line.length_mm, max(count, 2)))
            apart_mm = np.linalg.norm(points_mm[:, None] - kept[None], axis=2).min(axis=1, initial=np.inf)
            kept = np.concatenate([kept, points_mm[apart_mm > step_mm / 2]])
        return kept


@dataclass(frozen=True)
class PrincipalFrame:
    """Where a shape lies: its centre, its principal axes and its extent along them.

    An axis points where its largest component is positive, the third axis excepted, which completes a
    right-handed coordinate frame.

    Parameters
    ----------
    centre_mm : ndarray, shape (3,)
        Centre in mm.
    axes : ndarray, shape (3, 3)
        Right-handed unit axes in columns, longest first.
    spread_mm : ndarray, shape (3,)
        Standard deviation along each axis in mm.
    """

    centre_mm: Float64[np.ndarray, "3"]
    axes: Float64[np.ndarray, "3 3"]
    spread_mm: Float64[np.ndarray, "3"]


def principal_frame(
    points_mm: Float64[np.ndarray, "n 3"], weights: Float64[np.ndarray, " n"] | None = None
) -> PrincipalFrame:
    """Compute the principal axes of a cloud.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points in mm.
    weights : ndarray, shape (n,), optional
        Weight of each point; None weighs all alike.

    Returns
    -------
    PrincipalFrame
        Centre, axes and standard deviations.

    Examples
    --------
    >>> principal_frame(np.array([[0.0, 0, 0], [0, 4, 0], [0, 2, 1]])).axes[:, 0].round(3).tolist()
    [0.0, 1.0, 0.0]
    """
    centre_mm = np.average(points_mm, axis=0, weights=weights)
    centred_mm = points_mm - centre_mm
    share = np.full(len(points_mm), 1 / len(points_mm)) if weights is None else weights / weights.sum()
    variances, vectors = np.linalg.eigh((centred_mm * share[:, None]).T @ centred_mm)
    axes = vectors[:, ::-1].copy()
    for column in range(2):
        axes[:, column] *= np.sign(axes[np.abs(axes[:, column]).argmax(), column])
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return PrincipalFrame(centre_mm, axes, np.sqrt(np.maximum(variances[::-1], 0.0)))


def surface_frame(surface: Mesh | Float64[np.ndarray, "n 3"]) -> PrincipalFrame:
    """Compute the principal axes of a mesh, triangles weighted by area, or of a cloud.

    Parameters
    ----------
    surface : Mesh or ndarray, shape (n, 3)
        Mesh or points in mm.

    Returns
    -------
    PrincipalFrame
        Centre, axes and standard deviations.
    """
    if isinstance(surface, Mesh):
        # Exact for the triangles' second moment: the three mid-edges integrate a quadratic over a triangle.
        corners_mm = surface.corners_mm
        middles_mm = 0.5 * (corners_mm + np.roll(corners_mm, -1, axis=1))
        return principal_frame(middles_mm.reshape(-1, 3), np.repeat(surface.areas_mm2, 3))
    return principal_frame(surface)


def require_points(points_mm: ArrayLike, name: str, min_points: int = 1) -> Float64[np.ndarray, "n 3"]:
    """Return points as float64, or raise InputError naming them.

    Parameters
    ----------
    points_mm : array_like, shape (n, 3)
        Array, or anything that NumPy makes one of, such as a list of triples.
    name : str
        Name of the points, for messages.
    min_points : int, optional
        Smallest number of points.

    Returns
    -------
    ndarray, shape (n, 3)
        The same points, in an array of their own.

    Raises
    ------
    InputError
        If these are no numbers, of another shape, too few, masked, or not all finite.
    """
    if np.ma.is_masked(points_mm):
        raise InputError(f"{name}: expected points that all count, received an array with masked ones")
    try:
        found = np.asarray(points_mm)
        if found.dtype.kind not in "iuf":
            found = np.array([[_number(value) for value in row] for row in found.tolist()], dtype=np.float64)
        found = np.ascontiguousarray(found, dtype=np.float64)
    except (TypeError, ValueError) as refusal:
        raise InputError(
            f"{name}: expected points as an array of numbers of shape (n, 3), received {type(points_mm).__name__} "
            "that is none"
        ) from refusal
    if found.ndim != 2 or found.shape[1] != 3:
        if found.size == 0:
            raise InputError(f"{name}: expected at least {min_points} points, received 0")
        hint = ""
        if found.shape == (3,):
            hint = "; one point is points[None]"
        elif found.ndim == 2 and found.shape[0] == 3:
            hint = "; transpose it, points.T"
        elif found.ndim == 2 and found.shape[1] == 2:
            hint = "; points in a plane need a third coordinate"
        raise InputError(f"{name}: expected points of shape (n, 3), received shape {found.shape}{hint}")
    if len(found) < min_points:
        raise InputError(f"{name}: expected at least {min_points} points, received {len(found)}")
    if not np.isfinite(found).all():
        broken = int((~np.isfinite(found)).any(axis=1).sum())
        raise InputError(
            f"{name}: expected finite coordinates, received {broken} points with NaN or infinity"
        )
    return found


def require_cloud(points_mm: ArrayLike, name: str, min_points: int = 3) -> Float64[np.ndarray, "n 3"]:
    """Return a cloud that spans a surface as float64, or raise InputError naming it.

    Parameters
    ----------
    points_mm : array_like, shape (n, 3)
        Points in mm.
    name : str
        Name of the cloud, for messages.
    min_points : int, optional
        Smallest number of points.

    Returns
    -------
    ndarray, shape (n, 3)
        The same points.

    Raises
    ------
    InputError
        If ``require_points`` refuses them, or all lie on a point or a line.
    """
    cloud_mm = require_points(points_mm, name, min_points)
    extent_mm = np.ptp(cloud_mm, axis=0)
    if not extent_mm.any():
        raise InputError(
            f"{name}: expected points that span a surface, received {len(cloud_mm)} equal points"
        )
    spread_mm = principal_frame(cloud_mm).spread_mm
    if spread_mm[1] <= LINE_SHARE * spread_mm[0]:
        raise InputError(f"{name}: expected points that span a surface, received points on one line")
    return cloud_mm


def require_millimetres(cloud_mm: Float64[np.ndarray, "n 3"], name: str) -> Float64[np.ndarray, "n 3"]:
    """Return a cloud, or raise InputError if it is so small that it must be in metres.

    A piece of a vessel 2 m long would be 2 mm across as such; nothing that is registered here is as small as
    that.

    Parameters
    ----------
    cloud_mm : ndarray, shape (n, 3)
        Points, taken to be in mm.
    name : str
        Name of the cloud, for messages.

    Returns
    -------
    ndarray, shape (n, 3)
        The same points.

    Raises
    ------
    InputError
        If the bounding box's diagonal is shorter than ``METRES_BELOW_MM``.
    """
    across_mm = diagonal_mm(cloud_mm)
    if across_mm < METRES_BELOW_MM:
        raise InputError(
            f"{name}: expected coordinates in millimetres, received a cloud {across_mm:.3g} across, which looks like "
            f"metres; multiply it by 1000"
        )
    return cloud_mm


def _number(value: object) -> float:
    if isinstance(value, (str, bytes, bool, complex)) or value is None:
        raise TypeError
    return float(value)  # type: ignore[arg-type]


def diagonal_mm(points_mm: Float64[np.ndarray, "n 3"]) -> float:
    """Compute the diagonal of the axis-parallel bounding box.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3)
        Points in mm.

    Returns
    -------
    float
        Diagonal in mm.
    """
    return float(np.linalg.norm(np.ptp(points_mm, axis=0)))
