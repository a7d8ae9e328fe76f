"""What was published of the accuracy of rigid and deformable registration, by phantom and stage."""

from __future__ import annotations

from experiments.errors import InputError
from experiments.reporting.published import NOT_COMPARABLE, Published, published


def published_rmse(phantom: str, stage: str) -> Published | None:
    """Look up the published RMSE of a phantom after a stage.

    Parameters
    ----------
    phantom : str
        Name of the phantom.
    stage : str
        ``rigid`` or ``deformable``.

    Returns
    -------
    Published or None
        The value; None where none was published for this phantom.
    """
    try:
        return published("accuracy", f"rmse_mm_{phantom}_{stage}")
    except InputError:
        return None


def published_text(phantom: str, stage: str) -> str:
    """Write what was published of a phantom's RMSE after a stage, marked as not comparable with simulated data.

    Parameters
    ----------
    phantom : str
        Name of the phantom.
    stage : str
        ``rigid`` or ``deformable``.

    Returns
    -------
    str
        The value, or by how much the deformable stage was said to lower it; empty where nothing was published.
    """
    value = published_rmse(phantom, stage)
    if value is not None:
        return value.text_for(simulated=True)
    if stage == "deformable" and phantom in ("artificial", "vein"):
        less = published("accuracy", "rmse_reduction")
        return f"{less.text_with_unit} less ({NOT_COMPARABLE}: simulated)"
    return ""
