"""A sweep whose tissue deforms, and what is true of it: the rigid pose, and where material lies in that pose.

Four motions: the press of the probe and the bend of the body, which the simulator has itself, and a local indentation
and a rough random field, which have other forms.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from registration import transforms
from registration.benchmark.scenarios import PLACES, Kind
from registration.benchmark.sweep_simulation import RIGID, Swept, seen, simulated, sweep_settings
from registration.benchmark.tissue_displacement import draw_field, draw_indentation
from registration.errors import InputError
from registration.phantom.anatomy import anatomy_of
from registration.phantom.conditions import Deformation
from registration.phantom.displacement import Displacement
from registration.phantom.material_error import true_rigid_part
from registration.phantom.settings import RANDOM, SUBSETS

# Every other anatomy is swept in part, as most vessels are.
FRAMES, PART = 100, Kind("piece70", 0.7, PLACES)


def deformed_sweep(
    anatomy: str, seed: int, number: int, motion: str, size_mm: float, rng: np.random.Generator
) -> Swept:
    """Simulate a sweep whose tissue deforms.

    Parameters
    ----------
    anatomy : str
        Name of a designed vessel of the simulator, or of a random anatomy.
    seed : int
        Seed of the anatomy; of a designed vessel that of its tissue and sweeps. With an odd seed a part is swept.
    number : int
        Number of the sweep, from 0.
    motion : str
        ``press``, ``bend``, ``indentation`` or ``field``.
    size_mm : float
        Size of the motion in mm: how deep the probe presses at most, the largest displacement along the vessel of a
        bend or a field, that at the centre of an indentation.
    rng : numpy.random.Generator
        Random stream of the motion and of the choice of frames.

    Returns
    -------
    Swept
        The sweep and its points.

    Raises
    ------
    InputError
        If there is no such motion.
    """
    subset = anatomy if anatomy in SUBSETS else RANDOM
    deformation, displacement = RIGID, None
    guide_mm = anatomy_of(sweep_settings(subset, seed)).guide_mm
    if motion == "press":
        deformation = Deformation(bend_mm=0.0, pressure_mm=size_mm)
    elif motion == "bend":
        deformation = Deformation(bend_mm=size_mm, pressure_mm=0.0)
    else:
        displacement = _displacement(motion, guide_mm, size_mm, rng)
    sweep, lines = simulated(
        sweep_settings(subset, seed, deformation=deformation, frames=FRAMES), number, displacement
    )
    return replace(seen(sweep, lines, PART if seed % 2 else Kind("whole"), rng), deformed=True)


def material_truth(found: Swept) -> tuple[Float64[np.ndarray, "4 4"], Float64[np.ndarray, "t 3"]]:
    """Compute the rigid part of a sweep's deformation, and what of it no rigid pose undoes at the targets.

    A material point lies where it was when the image plane passed it nearest: that is what the sweep shows.

    Parameters
    ----------
    found : Swept
        Sweep whose tissue deforms.

    Returns
    -------
    fixed_T_swept : ndarray, shape (4, 4)
        Rigid transform that brings the wall of the whole model, as swept, nearest to where it is in the CT (least
        squares).
    displacement_mm : ndarray, shape (t, 3)
        Where the material of each target lies after that transform, less the target, in the ct frame in mm.
    """
    fixed_T_swept = true_rigid_part(found.sweep)
    shown_mm = found.sweep.deformation.as_swept(found.targets_mm)
    return fixed_T_swept, transforms.apply(fixed_T_swept, shown_mm) - found.targets_mm


def _displacement(
    motion: str, guide_mm: np.ndarray, size_mm: float, rng: np.random.Generator
) -> Displacement:
    if motion == "indentation":
        return draw_indentation(guide_mm, size_mm, rng)
    if motion == "field":
        return draw_field(guide_mm, size_mm, rng)
    raise InputError(f"motion: expected press, bend, indentation or field, received {motion!r}")
