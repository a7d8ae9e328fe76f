"""The end of the demonstration: two small tables and three sentences of what it left."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.pages.page_parts import read_cases
from experiments.errors import InputError
from experiments.statistics import wilson_interval

if TYPE_CHECKING:
    import pandas as pd

PARTS = ("segmentation", "pipeline", "robustness")


def closing(folder: Path) -> tuple[dict[str, pd.DataFrame], tuple[str, ...]]:
    """Sum up the three steps of the demonstration.

    Parameters
    ----------
    folder : Path
        Folder with what the steps wrote, each in a folder of its name.

    Returns
    -------
    tables : dict of str to pandas.DataFrame
        Segmentation and registration by title, as text.
    sentences : tuple of str
        One for each step.

    Raises
    ------
    InputError
        If a step has left nothing.
    """
    segmented, swept = (_json(folder / part / "metrics.json") for part in PARTS[:2])
    registered, trials = (
        _json(folder / "pipeline" / "registration.json"),
        read_cases(folder / "robustness", "the demonstration wrote"),
    )
    tables = {
        "Segmentation, simulated frames": _segmentation(segmented, swept),
        "Registration, simulated sweep": _registration(registered, swept, trials),
    }
    return tables, (_segmented(segmented), _registered(registered, swept), _tried(trials))


def _json(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise InputError(f"{path}: expected what the demonstration wrote, found none") from error


def _segmentation(segmented: dict[str, Any], swept: dict[str, Any]) -> pd.DataFrame:
    import pandas as pd

    rows = [
        {"frames": name, "DSC": f"{numbers['dsc_mean']:.3f}", "HD95 (mm)": f"{numbers['hd95_mm_mean']:.2f}"}
        for name, numbers in (
            ("of unseen sweeps, three folds", segmented),
            ("of the sweep registered below", swept),
        )
    ]
    return pd.DataFrame(rows)


def _registration(registered: dict[str, Any], swept: dict[str, Any], trials: pd.DataFrame) -> pd.DataFrame:
    import pandas as pd

    rows = [
        _row("rigid, from no initial pose", swept["rmse_mm"], swept["tre_mm"], registered["predicted_tre_mm"])
    ]
    if deformed := registered.get("deformable"):
        known = deformed.get("predicted_tre_at_targets_mm") or deformed.get("predicted_tre_mm")
        rows.append(_row("then deformable", swept["deformed_rmse_mm"], deformed["measured_tre_mm"], known))
    for (condition, method), own in trials.groupby(["condition", "method"], sort=False):
        name = f"{method}, turned up to {str(condition).rpartition('=')[2]} deg"
        row = _row(name, own["rmse_mm"].median(), own["tre_mm"].median(), None)
        rows.append(row | {"success": f"{int(own['success_tre'].sum())} of {len(own)}"})
    return pd.DataFrame(rows)


def _row(name: str, rmse_mm: object, tre_mm: object, predicted: dict[str, Any] | None) -> dict[str, str]:
    bounds = [] if predicted is None else [_number(predicted.get(end)) for end in ("low", "high")]
    return {
        "stage or method": name,
        "success": "",
        "RMSE (mm)": _number(rmse_mm),
        "TRE (mm)": _number(tre_mm),
        "predicted TRE": f"{bounds[0]} to {bounds[1]}" if all(bounds) and bounds else "",
    }


def _number(value: object) -> str:
    """Two decimals; empty for what is missing."""
    number = float(value) if isinstance(value, (int, float, str)) else math.nan
    return "" if math.isnan(number) else f"{number:.2f}"


def _segmented(numbers: dict[str, Any]) -> str:
    return (
        f"U-Net segments simulated frames of unseen sweeps with a mean DSC of {numbers['dsc_mean']:.3f} and a "
        f"mean HD95 of {numbers['hd95_mm_mean']:.2f} mm."
    )


def _registered(registered: dict[str, Any], swept: dict[str, Any]) -> str:
    deformed = registered.get("deformable")
    after = f" and {_number(deformed['measured_tre_mm'])} mm after the deformable stage" if deformed else ""
    return (
        f"The sweep's contours lie {_number(swept['rmse_mm'])} mm (RMSE) from the model from CT; the true error at the "
        f"targets is {_number(swept['tre_mm'])} mm{after}. Verdict: {registered['verdict']}, {registered['reason']}."
    )


def _tried(trials: pd.DataFrame) -> str:
    last = trials[trials["condition"] == trials["condition"].iloc[-1]]
    parts = []
    for method, own in last.groupby("method", sort=False):
        rate = wilson_interval(int(own["success_tre"].sum()), len(own))
        accepted = (
            f", {(own['verdict'] == 'accepted').sum()} accepted by the method itself" if _judged(own) else ""
        )
        parts.append(
            f"{method} {rate.successes} of {rate.trials} ({100 * rate.low:.0f} to {100 * rate.high:.0f} %{accepted})"
        )
    degrees = str(last["condition"].iloc[0]).rpartition("=")[2]
    return (
        f"Turned by up to {degrees} degrees, within 2 mm of the truth: {', '.join(parts)}; one that finds "
        "the same pose from every start has the same row at all angles."
    )


def _judged(trials: pd.DataFrame) -> bool:
    """Whether a method says which of its results it accepts."""
    return "verdict" in trials and bool(trials["verdict"].isin(["accepted", "ambiguous"]).any())
