"""Other programs for Coherent Point Drift, on the same clouds and with the same settings as ours, for comparison.

None of them is needed otherwise: pycpd (MIT) and rcpd (GPL 3) are used where they are installed, and the program of
Bayesian Coherent Point Drift (BCPD, MIT) where it was built. All move a model's points onto swept ones.
"""

from __future__ import annotations

import subprocess
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from registration.deformable.point_drift import PointResiduals
from registration.errors import InputError

# The normalised deviation that BCPD starts with is scaled so where clouds are registered rigidly (its manual).
GAMMA = 0.1
# Points that BCPD draws for its matching, as its manual proposes for clouds of several thousand.
NYSTROM_POINTS = 300
TIMEOUT_S = 3600


def require_package(name: str) -> None:
    """Raise InputError if a comparator's package is not installed.

    Parameters
    ----------
    name : str
        Name of the package.

    Raises
    ------
    InputError
        If it is missing; the message names the command that installs it.
    """
    if find_spec(name) is None:
        raise InputError(f"{name}: expected the package to be installed (pip install {name}), found none")


def drift_by_pycpd(
    model_mm: Float64[np.ndarray, "m 3"], swept_mm: Float64[np.ndarray, "n 3"], settings: PointResiduals
) -> Float64[np.ndarray, "m 3"]:
    """Move a model by pycpd, which uses all pairs and the full kernel.

    Parameters
    ----------
    model_mm : ndarray, shape (m, 3)
        Points of the model in mm.
    swept_mm : ndarray, shape (n, 3)
        Swept points in mm.
    settings : PointResiduals
        Settings; pycpd chooses its own first deviation.

    Returns
    -------
    ndarray, shape (m, 3)
        Moved points in mm.

    Raises
    ------
    InputError
        If pycpd is not installed.
    """
    require_package("pycpd")
    from pycpd import DeformableRegistration

    drift = DeformableRegistration(
        X=swept_mm,
        Y=model_mm,
        beta=settings.beta_mm,
        alpha=settings.roughness_per_mm2,
        w=settings.outlier_weight,
        max_iterations=settings.max_iterations,
        tolerance=settings.tolerance,
    )
    return np.asarray(drift.register()[0])


def drift_by_rcpd(
    model_mm: Float64[np.ndarray, "m 3"], swept_mm: Float64[np.ndarray, "n 3"], settings: PointResiduals
) -> Float64[np.ndarray, "m 3"]:
    """Move a model by rcpd, which solves through the largest modes of the kernel.

    Parameters
    ----------
    model_mm : ndarray, shape (m, 3)
        Points of the model in mm.
    swept_mm : ndarray, shape (n, 3)
        Swept points in mm.
    settings : PointResiduals
        Settings; rcpd chooses its own first deviation where none is given.

    Returns
    -------
    ndarray, shape (m, 3)
        Moved points in mm.

    Raises
    ------
    InputError
        If rcpd is not installed.
    """
    require_package("rcpd")
    import rcpd

    # It takes the kernel's width as a share of the model's radius, and roughness in these units.
    radius_mm = float(np.sqrt(model_mm.var(axis=0).sum()))
    fit = rcpd.register_deform(
        model_mm,
        swept_mm,
        alpha=settings.roughness_per_mm2 * radius_mm**2,
        beta=settings.beta_mm / radius_mm,
        w=settings.outlier_weight,
        tolerance=settings.tolerance,
        max_iterations=settings.max_iterations,
        sigma2=None if settings.sigma0_mm is None else settings.sigma0_mm**2,
        num_modes=min(settings.rank, len(model_mm)),
    )
    return np.asarray(fit.apply(model_mm), dtype=np.float64)


def drift_by_bcpd(
    program: Path,
    model_mm: Float64[np.ndarray, "m 3"],
    swept_mm: Float64[np.ndarray, "n 3"],
    settings: PointResiduals,
) -> Float64[np.ndarray, "m 3"]:
    """Move a model by the program of Bayesian Coherent Point Drift.

    Its kernel has the same width in millimetres, its displacements the expected length, and it runs for as many
    iterations, with a low-rank kernel, Nystrom's method for the matching and its k-d tree.

    Parameters
    ----------
    program : Path
        The program ``bcpd``.
    model_mm : ndarray, shape (m, 3)
        Points of the model in mm.
    swept_mm : ndarray, shape (n, 3)
        Swept points in mm.
    settings : PointResiduals
        Settings.

    Returns
    -------
    ndarray, shape (m, 3)
        Moved points in mm.

    Raises
    ------
    InputError
        If the program is missing, fails, or writes no moved point for each of the model.

    References
    ----------
    O. Hirose, IEEE TPAMI 43(7), 2021, and github.com/ohirose/bcpd.
    """
    if not program.is_file():
        raise InputError(f"{program}: expected the program bcpd, found no file")
    with tempfile.TemporaryDirectory() as folder:
        target, source, out = (Path(folder) / name for name in ("target.txt", "source.txt", "out_"))
        np.savetxt(target, swept_mm, fmt="%.9g", delimiter=",")
        np.savetxt(source, model_mm, fmt="%.9g", delimiter=",")
        words = [str(program.resolve()), "-x", str(target), "-y", str(source), "-o", str(out), "-s", "y"]
        _run(program, [*words, *_bcpd_options(model_mm, swept_mm, settings)])
        found = Path(f"{out}y.txt")
        try:
            moved_mm = np.loadtxt(found, ndmin=2)
        except (OSError, ValueError) as refusal:
            raise InputError(
                f"{program}: expected moved points in {found.name}, received none that can be read"
            ) from refusal
    if moved_mm.shape != model_mm.shape or not np.isfinite(moved_mm).all():
        raise InputError(
            f"{program}: expected {len(model_mm)} finite points, received an array of shape {moved_mm.shape}"
        )
    return np.asarray(moved_mm)


def _bcpd_options(model_mm: np.ndarray, swept_mm: np.ndarray, settings: PointResiduals) -> list[str]:
    """Settings as BCPD has them: lengths over the root mean square coordinate of the model, by which it divides."""
    scale_mm = float(np.sqrt(model_mm.var(axis=0).mean()))
    # The expected length of a displacement is the root of 3 / lambda.
    stiffness = 3.0 * (scale_mm / settings.expected_deformation_mm) ** 2
    chosen = {
        "-u": "y",
        "-w": settings.outlier_weight,
        "-b": f"{settings.beta_mm / scale_mm:.6g}",
        "-l": f"{stiffness:.6g}",
        "-g": GAMMA,
        "-n": settings.max_iterations,
        "-N": settings.max_iterations,
        "-c": settings.tolerance,
        "-K": min(settings.rank, len(model_mm)),
        "-J": min(NYSTROM_POINTS, len(model_mm) + len(swept_mm)),
        "-r": 1,
    }
    return [*(str(word) for pair in chosen.items() for word in pair), "-p", "-q"]


def _run(program: Path, words: list[str]) -> None:
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=TIMEOUT_S)
    except (OSError, subprocess.TimeoutExpired) as refusal:
        raise InputError(f"{program}: expected a program that can be run, received {refusal}") from refusal
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()[-1].strip()
        raise InputError(
            f"{program}: expected a program that ends well, received exit status {done.returncode} and {said!r}"
        )
