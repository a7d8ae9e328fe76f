"""How far each stage of a multi-start search takes its poses: points, iterations, and how many poses go on."""

from __future__ import annotations

from dataclasses import dataclass

from registration.checks import require_count, require_positive
from registration.rigid.coarse_to_fine import EARLY_TOLERANCE, Stage


@dataclass(frozen=True)
class Stages:
    """Sizes of the four stages: first and coarse on a table of closest points, middle and fine on exact ones.

    Parameters
    ----------
    first_points : int, optional
        Number of moving points in the first stage, which all starts go through.
    first_iterations : int, optional
        Its iterations.
    first_share : float, optional
        Share of the starts that survives it, above 0 to 1.
    coarse_points : int, optional
        Number of moving points in the second stage.
    coarse_cells : int, optional
        Voxels a side of the table of closest points of both early stages.
    coarse_iterations : int, optional
        Iterations of the second stage.
    survivors : int, optional
        Number of poses of different basins that go on from it, for each axis that is tried as the vessel's.
    middle_points : int, optional
        Number of moving points in the third stage.
    finalists : int, optional
        Largest number of poses that go on from it.
    fine_points : int, optional
        Largest number of moving points in the last stage.
    max_iterations : int, optional
        Largest number of iterations in each of the last two stages.
    tolerance : float, optional
        Relative change of the residual below which a pose has settled.
    basin_share : float, optional
        Poses that move the cloud alike within this share of its radius are in one basin.

    Raises
    ------
    InputError
        If a count is too small or a share is outside its range.
    """

    first_points: int = 150
    first_iterations: int = 6
    first_share: float = 0.34
    coarse_points: int = 300
    coarse_cells: int = 48
    coarse_iterations: int = 8
    survivors: int = 8
    middle_points: int = 600
    finalists: int = 3
    fine_points: int = 5000
    max_iterations: int = 50
    tolerance: float = 2e-4
    basin_share: float = 0.1

    def __post_init__(self) -> None:
        for name in ("first_iterations", "coarse_iterations", "survivors", "finalists", "max_iterations"):
            require_count(name, getattr(self, name), 1)
        for name in ("first_points", "coarse_points", "middle_points", "fine_points"):
            require_count(name, getattr(self, name), 3)
        require_count("coarse_cells", self.coarse_cells, 8)
        for name in ("first_share", "tolerance", "basin_share"):
            require_positive(name, getattr(self, name), 1.0)

    def each(self, axes_tried: int) -> dict[str, Stage]:
        """Compute the stages of one search.

        Parameters
        ----------
        axes_tried : int
            Number of axes that are tried as the vessel's. As many times more poses go on from the coarse stage: the
            right one has more rivals on few points.

        Returns
        -------
        dict of str to Stage
            Stages by name: ``first``, ``coarse``, ``middle`` and ``fine``.
        """
        middle_tolerance = max(self.tolerance, EARLY_TOLERANCE)
        # How many go on from the first stage is a share of the starts.
        stages = (
            Stage("first", self.first_points, self.first_iterations, EARLY_TOLERANCE, 0),
            Stage(
                "coarse",
                self.coarse_points,
                self.coarse_iterations,
                EARLY_TOLERANCE,
                self.survivors * axes_tried,
            ),
            Stage("middle", self.middle_points, self.max_iterations, middle_tolerance, self.finalists),
            Stage("fine", self.fine_points, self.max_iterations, self.tolerance, 1),
        )
        return {stage.name: stage for stage in stages}
