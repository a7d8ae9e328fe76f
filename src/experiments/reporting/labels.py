"""What the figures call a column, and one look for each method in all of them.

Tables and files keep the names of the columns; a reader of a figure gets plain words with the unit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from registration.metrics.surface_distance import SUCCESS_RMSE_MM, SUCCESS_TRE_MM

LABELS = {
    "acceptance_rate": "Acceptance rate",
    "ambiguity_gap": "Ambiguity gap",
    "angle_deg": "Rotation (deg)",
    "beta_mm": "Kernel width beta (mm)",
    "column_px": "Column (px)",
    "deformed_tre_mm": "TRE, deformable stage (mm)",
    "dsc": "DSC",
    "error_mm": "Error (mm)",
    "hd95_mm": "HD95 (mm)",
    "hd95_px": "HD95 (px)",
    "interval_ms": "Interval (ms)",
    "lag_s": "Lag (s)",
    "missing_share": "Share of frames missing",
    "msd_mm": "Mean surface distance (mm)",
    "noise_mm": "Noise, standard deviation (mm)",
    "outlier_share": "Share of outliers",
    "overlap": "Overlap",
    "residual_mm": "Residual (mm)",
    "residual_px": "Residual (px)",
    "rmse_mm": "RMSE (mm)",
    "roll_deg": "Roll about the vessel (deg)",
    "roughness_per_mm2": "Weight of roughness lambda (1/mm²)",
    "row_px": "Row (px)",
    "runtime_s": "Runtime (s)",
    "success_rate": f"Success rate, RMSE <= {SUCCESS_RMSE_MM:g} mm",
    "success_tre_rate": f"Success rate, TRE <= {SUCCESS_TRE_MM:g} mm",
    "surface_hd95_mm": "HD95 of the surface (mm)",
    "surface_rmse_mm": "RMSE of the surface (mm)",
    "time_s": "Time (s)",
    "train_loss": "Training loss",
    "translation_mm": "Translation (mm)",
    "tre_covered_mm": "TRE, swept part (mm)",
    "tre_high_mm": "Predicted TRE, upper end (mm)",
    "tre_mm": "TRE (mm)",
    "tre_symmetric_mm": "TRE up to symmetry (mm)",
    "tre_uncovered_mm": "TRE, part not swept (mm)",
    "validation_dsc": "Validation DSC",
    "validation_loss": "Validation loss",
    "x_mm": "x (mm)",
    "y_mm": "y (mm)",
    "z_mm": "z (mm)",
}
METHODS = {
    "multistart": "Multi-start ICP",
    "single_icp": "ICP",
    "fpfh_ransac": "FPFH + RANSAC",
    "single_icp_plane": "ICP, point-to-plane",
    "gicp": "GICP",
    "single_icp_centred": "ICP, centred",
    "fpfh_fgr": "FPFH + FGR",
    "kiss_matcher": "KISS-Matcher",
    "multistart_no_centerline": "No centerline",
    "multistart_no_inversion": "No inversion",
    "multistart_no_offset": "No offset",
    "multistart_no_pruning": "No pruning",
    "multistart_no_slide": "No slide",
    "multistart_one_start": "One start",
    "cpd": "Deformable, along normals",
    "cpd_point": "Coherent Point Drift",
    "cpd_rigid": "Coherent Point Drift, rigid",
    "attention_unet": "Attention U-Net",
    "basic_unet": "Basic U-Net",
    "efficientnet_unet": "EfficientNet-Lite0 U-Net",
    "unet": "U-Net",
    "unet3plus": "UNet 3+",
}
# What networks of a comparison were trained on, or what stands in their place.
TRAINED_ON = {
    "reference": "Reference masks",
    "single_session": "Single session",
    "full": "Full",
    "pruned": "Pruned",
    "full_as_single_session": "Full, as many as single session",
    "full_as_pruned": "Full, as many as pruned",
}
UNITS = ("mm3", "mm2", "mm", "px", "deg", "ms", "s")
# Told apart by colour-blind readers too (Okabe and Ito, Color Universal Design, 2008); the markers repeat it.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
# Places among colours and markers. A variant of multi-start registration has the colour of a method that it is
# seldom drawn with, under another marker.
PLACES = {name: (place, place) for place, name in enumerate(list(METHODS)[:8])} | {
    name: (place, place + 1) for place, name in enumerate(list(METHODS)[8:14], start=1)
}


def axis_label(column: str) -> str:
    """Name a column in plain words with its unit.

    Parameters
    ----------
    column : str
        Name of the column, with its unit last (``tre_mm``).

    Returns
    -------
    str
        Label of an axis or of a legend's entry, without underscores. A column that is not in the table gets the
        words of its name.

    Examples
    --------
    >>> axis_label("angle_deg"), axis_label("wall_gap_mm")
    ('Rotation (deg)', 'Wall gap (mm)')
    """
    if column in LABELS:
        return LABELS[column]
    words, _, unit = column.rpartition("_")
    text = f"{words} ({unit})" if words and unit in UNITS else column
    plain = text.replace("_", " ").strip()
    return plain[:1].upper() + plain[1:]


def counted(count: int, what: str) -> str:
    """Write a number of things.

    Parameters
    ----------
    count : int
        How many.
    what : str
        Name of one.

    Returns
    -------
    str
        The number with the name in the right form.

    Examples
    --------
    >>> counted(1, "run"), counted(2, "run")
    ('1 run', '2 runs')
    """
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def method_label(name: str) -> str:
    """Name a method or a network as a figure does.

    Parameters
    ----------
    name : str
        Name of its option (``fpfh_ransac``), possibly with the settings of a variant behind it.

    Returns
    -------
    str
        The name in plain words, without underscores.

    Examples
    --------
    >>> method_label("fpfh_ransac"), method_label("my_method")
    ('FPFH + RANSAC', 'my method')
    """
    return (METHODS | TRAINED_ON).get(name, name.replace("_", " "))


def method_styles(methods: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Choose colour and marker of each method, the same in every figure.

    Parameters
    ----------
    methods : sequence of str
        Names of the methods in a figure.

    Returns
    -------
    dict
        Keyword arguments ``color`` and ``marker`` of matplotlib by method. Methods that have no look of their own
        take the first that are left over.
    """
    known = {name: PLACES[name] for name in methods if name in PLACES}
    taken = {colour for colour, _ in known.values()}
    free = [place for place in range(len(COLOURS)) if place not in taken] or list(range(len(COLOURS)))
    others = [name for name in methods if name not in PLACES]
    chosen = known | {name: (free[number % len(free)],) * 2 for number, name in enumerate(others)}
    return {name: {"color": COLOURS[chosen[name][0]], "marker": MARKERS[chosen[name][1]]} for name in methods}
