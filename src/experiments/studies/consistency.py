"""Study ``consistency``: repeated sweeps of a phantom, reconstructed, compared with each other and with the truth."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.errors import InputError
from experiments.outcome import CellResult, Outcome, Progress
from experiments.studies.consistency_report import COMMON, PAIR, TRUTH, describe, figures, metrics, tables
from experiments.studies.reconstruction import CloudFilter, Reconstruction
from registration import frames
from registration.agreement import counterparts, surface_agreement
from registration.contours import ContourExtractor
from registration.geometry import Mesh
from registration.phantom.scan import SimulatedSweep, simulate_sweep
from registration.phantom.settings import MESH, PhantomSettings
from registration.smoothing import TaubinSmoothing
from registration.surface import SurfaceMethod
from registration.synchronisation import synchronise

if TYPE_CHECKING:
    from models.predictor import Predictor

MASKS = ("exact", "model")
# In place of the number of a sweep, where a row has none.
NONE = -1


@dataclass(frozen=True)
class _Repeat:
    """One reconstructed sweep: as tracked (``seen``) and with the known deformation taken out (``material``), in ct.

    ``offset_mm`` is how far it lies outside the truth at each of many places of the truth, NaN where it has no
    counterpart; ``row`` is its row of the table.
    """

    seen: Mesh
    material: Mesh
    offset_mm: np.ndarray
    row: dict[str, Any]


def cells(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One cell for each phantom."""
    phantoms = config.get("phantoms")
    if not isinstance(phantoms, Sequence) or isinstance(phantoms, str) or not phantoms:
        raise InputError(f"phantoms: expected a list of phantoms, received {phantoms!r}")
    return [{"phantoms": [name]} for name in phantoms]


def check(
    *, phantom: PhantomSettings, phantoms: Sequence[str], sweeps: int, masks: str, model_path: str | None
) -> None:
    """Raise InputError for settings that allow no comparison."""
    _settings(phantom, phantoms)
    if isinstance(sweeps, bool) or not isinstance(sweeps, int) or sweeps < 2:
        raise InputError(f"sweeps: expected a whole number of at least 2, received {sweeps!r}")
    if masks not in MASKS:
        raise InputError(f"masks: expected {' or '.join(MASKS)}, received {masks!r}")
    if (masks == "model") != (model_path is not None):
        raise InputError(f"model_path: expected a network with masks=model only, received {model_path!r}")
    if model_path is not None and not Path(model_path).is_file():
        raise InputError(
            f"model_path: expected a network trained by study=segmentation (model.pt), received {model_path!r}"
        )


def run(
    *,
    phantom: PhantomSettings,
    phantoms: Sequence[str],
    contours: ContourExtractor,
    filters: Mapping[str, CloudFilter],
    surface: SurfaceMethod,
    smoothing: TaubinSmoothing,
    sweeps: int,
    masks: str,
    model_path: str | None,
    max_gap_s: float,
    samples: int,
    seed: int,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Reconstruct ``sweeps`` simulated sweeps of one phantom and compare all pairs, and each with the anatomy.

    Pairs are compared as tracked, without any registration, as the sweeps share their world; and once more with the
    known deformation taken out. The truth is the undeformed anatomy, so what is compared with it is each place of the
    tissue. Raises InputError for settings that allow no comparison.
    """
    import pandas as pd

    del workspace
    check(phantom=phantom, phantoms=phantoms, sweeps=sweeps, masks=masks, model_path=model_path)
    settings = _settings(phantom, phantoms)
    chain = Reconstruction(contours, filters, surface, smoothing)
    predictor = _predictor(model_path)
    repeats = []
    for number in progress.track(range(sweeps), f"{settings.subset}: sweeps", sweeps):
        truth = simulate_sweep(settings, number, pictures=predictor is not None)
        repeats.append(_repeat(truth, chain, predictor, max_gap_s, (samples, seed)))
    pairs = list(itertools.combinations(range(sweeps), 2))
    rows = [{**repeat.row, "first": number} for number, repeat in enumerate(repeats)]
    rows.append(_common([repeat.offset_mm for repeat in repeats]))
    for first, second in progress.track(pairs, f"{settings.subset}: pairs", len(pairs)):
        rows.append(_pair(repeats[first], repeats[second], (first, second), (samples, seed)))
    cases = pd.DataFrame(rows).assign(phantom=settings.subset, masks=masks, simulated=True)
    return Outcome(
        metrics=metrics(cases),
        cases=cases,
        tables=tables(cases),
        figures=figures(cases),
        findings=describe(cases),
        tags={"phantom": settings.subset, "masks": masks, "simulated": "true"},
    )


def summarise(cells: list[CellResult]) -> Outcome:
    """Set all phantoms side by side."""
    import pandas as pd

    known = [cell.cases for cell in cells if cell.cases is not None and len(cell.cases)]
    if not known:
        return Outcome(findings=("No job has sweeps to compare.",))
    cases = pd.concat(known, ignore_index=True)
    return Outcome(
        metrics=metrics(cases),
        cases=cases,
        tables=tables(cases),
        figures=figures(cases),
        findings=describe(cases),
    )


def _settings(phantom: PhantomSettings, phantoms: Sequence[str]) -> PhantomSettings:
    if len(phantoms) != 1:
        raise InputError(f"phantoms: expected one phantom a job, received {len(phantoms)}")
    if bool(phantom.mesh) != (phantoms[0] == MESH):
        raise InputError(
            f"phantoms: expected [{MESH}] with phantom.mesh and only then, received {phantoms[0]!r} "
            f"and phantom.mesh={phantom.mesh!r}"
        )
    return replace(phantom, subset=phantoms[0])


def _predictor(model_path: str | None) -> Predictor | None:
    if model_path is None:
        return None
    from models.predictor import Predictor

    return Predictor.load(model_path)


def _repeat(
    truth: SimulatedSweep,
    chain: Reconstruction,
    predictor: Predictor | None,
    max_gap_s: float,
    drawn: tuple[int, int],
) -> _Repeat:
    masks = truth.masks if predictor is None else predictor.probability(truth.sweep.images)
    posed = synchronise(truth.sweep, max_gap_s)
    found = chain(masks[posed.kept], posed.world_A_pixel)
    seen_mm = frames.apply(truth.ct_T_world, found.surface.vertices_mm)
    seen = Mesh(seen_mm, found.surface.triangles)
    material = Mesh(truth.deformation.material(seen_mm), found.surface.triangles)
    samples, seed = drawn
    offset_mm = _offset_mm(material, truth.anatomy, samples, seed)
    row = {
        "kind": TRUTH,
        "second": NONE,
        **asdict(surface_agreement(material, truth.anatomy, samples=samples, seed=seed)),
        "bias_mm": float(np.nanmean(offset_mm)),
        "frames": len(posed.kept),
        "points": len(found.cloud),
        "frames_dropped": sum(posed.dropped.values()),
        "runtime_s": sum(found.seconds.values()),
    }
    return _Repeat(seen, material, offset_mm, row)


def _offset_mm(found: Mesh, truth: Mesh, samples: int, seed: int) -> np.ndarray:
    """How far ``found`` lies outside the truth, along its normal, at places of the truth that all sweeps share."""
    rng = np.random.default_rng([seed, 2])
    corners_mm = truth.corners_mm[
        rng.choice(len(truth.triangles), samples, p=truth.areas_mm2 / truth.areas_mm2.sum())
    ]
    outwards = np.cross(corners_mm[:, 1] - corners_mm[:, 0], corners_mm[:, 2] - corners_mm[:, 0])
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    places_mm = corners_mm.mean(axis=1)
    there = counterparts(places_mm, found)
    along_mm = np.einsum("pi,pi->p", there.points_mm - places_mm, outwards)
    return np.where(there.covered, along_mm, np.nan)


def _common(offsets_mm: Sequence[np.ndarray]) -> dict[str, Any]:
    """The row of the error that all sweeps share: at each place of the truth, the mean over the sweeps that show it."""
    stacked_mm = np.stack(offsets_mm)
    shown = np.isfinite(stacked_mm).all(axis=0)
    if not shown.any():
        raise InputError("sweeps: expected a part of the vessel that all sweeps show, received none")
    mean_mm = stacked_mm[:, shown].mean(axis=0)
    return {
        "kind": COMMON,
        "first": NONE,
        "second": NONE,
        "msd_covered_mm": float(np.abs(mean_mm).mean()),
        "hd95_covered_mm": float(np.percentile(np.abs(mean_mm), 95)),
        "bias_mm": float(mean_mm.mean()),
        "covered_second": float(shown.mean()),
    }


def _pair(
    first: _Repeat, second: _Repeat, numbers: tuple[int, int], drawn: tuple[int, int]
) -> dict[str, Any]:
    samples, seed = drawn
    seen = surface_agreement(first.seen, second.seen, samples=samples, seed=seed)
    material = surface_agreement(first.material, second.material, samples=samples, seed=seed)
    return {
        "kind": PAIR,
        "first": numbers[0],
        "second": numbers[1],
        **asdict(seen),
        "msd_tissue_mm": material.msd_covered_mm,
        "hd95_tissue_mm": material.hd95_covered_mm,
    }
