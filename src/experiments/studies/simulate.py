"""Study ``simulate``: a sweep of the built-in simulator as files, as if a laboratory had recorded it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments import files
from experiments.analysis.registration.simulated_truth import truth_record
from experiments.errors import InputError
from experiments.outcome import Outcome, Progress
from registration.io.surfaces import write_surface
from registration.phantom.scan import simulate_sweep
from registration.phantom.settings import PhantomSettings
from registration.readers.folder import write_folder

if TYPE_CHECKING:
    import pandas as pd

# It makes data and measures nothing.
TRACKED = False


def check(*, sweep_index: int) -> None:
    """Check the number of the sweep.

    Parameters
    ----------
    sweep_index : int
        Number of the simulated sweep, from 0.

    Raises
    ------
    InputError
        If ``sweep_index`` is not a whole number from 0.
    """
    if isinstance(sweep_index, bool) or not isinstance(sweep_index, int) or sweep_index < 0:
        raise InputError(f"sweep_index: expected a whole number from 0, received {sweep_index!r}")


def _table(phantom: PhantomSettings, sweep_index: int, frames: int) -> pd.DataFrame:
    """What was simulated, in one row."""
    import pandas as pd

    row = {
        "phantom": phantom.subset,
        "sweep": sweep_index,
        "frames": frames,
        "duration_s": float(phantom.motion.duration_s),
        "length_mm": float(phantom.motion.length_mm),
        "seed": phantom.seed,
    }
    return pd.DataFrame([row])


def run(*, phantom: PhantomSettings, sweep_index: int, workspace: Path, progress: Progress) -> Outcome:
    """Simulate one sweep and its truth.

    Leaves ``sweep/`` (plain folder), ``masks/*.png``, ``model.ply`` (ct), ``truth.json`` and ``truth.npz`` in
    ``workspace``. ``truth.json`` has ``ct_T_world`` (also under the name of a registration's result,
    ``fixed_T_moving``), the points at which ``study=evaluate`` measures such a result (ct, mm) and the
    phantom's settings by their digest; ``truth.npz`` has the true ``world_A_pixel`` (n, 4, 4) of every frame
    and, where the anatomy has one, the centerline's points and radii (ct, mm).

    Parameters
    ----------
    phantom : PhantomSettings
        Settings of the phantom.
    sweep_index : int
        Number of the simulated sweep, from 0.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Number of frames and findings.

    Raises
    ------
    InputError
        If ``sweep_index`` is not a whole number from 0.
    """
    from PIL import Image

    check(sweep_index=sweep_index)
    progress.note(f"simulating {phantom.motion.frames} frames")
    truth = simulate_sweep(phantom, sweep_index)
    write_folder(workspace / "sweep", truth.sweep)
    (workspace / "masks").mkdir()
    for index, mask in enumerate(progress.track(truth.masks, "Writing masks", len(truth.masks))):
        Image.fromarray(mask.astype(np.uint8) * 255).save(workspace / "masks" / f"{index:06d}.png")
    write_surface(workspace / "model.ply", truth.model)
    record = {
        "ct_T_world": truth.ct_T_world.tolist(),
        **truth_record(truth),
        "phantom": phantom.digest(),
        "sweep_index": sweep_index,
    }
    files.write_text(workspace / "truth.json", json.dumps(record))
    arrays = {"world_A_pixel": truth.world_A_pixel}
    if truth.centerline is not None:
        arrays["centerline_mm"] = np.concatenate([line.points_mm for line in truth.centerline.lines])
        arrays["radius_mm"] = np.concatenate([line.radius_mm for line in truth.centerline.lines])
    np.savez_compressed(workspace / "truth.npz", allow_pickle=False, **arrays)
    return Outcome(
        metrics={"frames": float(len(truth.masks))},
        tables={"simulated sweep": _table(phantom, sweep_index, len(truth.masks))},
        findings=(f"Simulated sweep {sweep_index} of phantom {phantom.subset}: {len(truth.masks)} frames.",),
    )
