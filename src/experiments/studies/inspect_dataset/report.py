"""What ``inspect_dataset`` shows: numbers, tables, sentences, and a contact sheet of images with mask outlines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, SupportsFloat

import numpy as np

from experiments.datasets.images.near_duplicates import CrossGroupDuplicates
from models.labelled_frames import LabelledFrames

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OUTLINE_COLOUR = "tab:orange"
# Larger pictures than this don't show more on a sheet.
SHOWN_PX = 400
COLUMNS = 6
QUANTILES = {"p05": 0.05, "p25": 0.25, "median": 0.5, "p75": 0.75, "p95": 0.95}
ODDITIES = {
    "several_components": "masks of several components",
    "with_holes": "masks with holes",
    "touching_edge": "masks that touch the image's edge",
}


def metrics(cases: pd.DataFrame, alike: CrossGroupDuplicates, leaks: int | None) -> dict[str, float]:
    """Compute counts and distributions.

    Parameters
    ----------
    cases : pandas.DataFrame
        One row per case, as ``case_table`` makes them.
    alike : CrossGroupDuplicates
        Near-duplicates across groups.
    leaks : int or None
        Number of pairs of near-duplicates that leak; None where there is no split.

    Returns
    -------
    dict
        Scalars by name; ``near_duplicates_leaking`` only where there is a split.
    """
    shown = cases[cases["vessel_px"] > 0]
    sizes = cases.groupby("group").size()
    numbers: dict[str, SupportsFloat] = {
        "images": len(cases),
        "images_with_vessel": len(shown),
        "images_with_vessel_share": len(shown) / len(cases),
        "image_sizes": len(cases[["height_px", "width_px"]].drop_duplicates()),
        "spacing_known": int(cases["vertical_mm"].notna().sum()),
        "groups": len(sizes),
        "group_size_min": sizes.min(),
        "group_size_median": sizes.median(),
        "group_size_max": sizes.max(),
        **{f"vessel_share_{name}": shown["vessel_share"].quantile(at) for name, at in QUANTILES.items()},
        "several_components": int((cases["components"] > 1).sum()),
        "with_holes": int((cases["holes"] > 0).sum()),
        "touching_edge": int(cases["touches_edge"].sum()),
        "near_duplicates_across_groups": len(alike.pairs),
        "images_with_near_duplicate_elsewhere": len(np.unique(alike.pairs)),
        **({} if leaks is None else {"near_duplicates_leaking": leaks}),
    }
    return {name: float(value) for name, value in numbers.items()}


def overview(cases: pd.DataFrame, numbers: Mapping[str, float]) -> pd.DataFrame:
    """Summarise a data set in a few lines.

    Parameters
    ----------
    cases : pandas.DataFrame
        One row per case, as ``case_table`` makes them.
    numbers : Mapping[str, float]
        Metrics that ``metrics`` returns.

    Returns
    -------
    pandas.DataFrame
        Columns ``what`` and ``value``.
    """
    import pandas as pd

    areas = " / ".join(f"{100 * numbers[f'vessel_share_{name}']:.2f}" for name in QUANTILES)
    lines = [
        ("images", f"{numbers['images']:.0f}"),
        ("images with a vessel", f"{_count(numbers, 'images_with_vessel')}"),
        ("vessel's share of the image, 5 / 25 / 50 / 75 / 95 % quantile", f"{areas} %"),
        ("pixel size", _spacing(cases)),
        ("groups", f"{numbers['groups']:.0f}"),
        (
            "images a group",
            f"{numbers['group_size_min']:.0f} to {numbers['group_size_max']:.0f}, "
            f"median {numbers['group_size_median']:g}",
        ),
        *((what, _count(numbers, name)) for name, what in ODDITIES.items()),
        (
            "images with a near-duplicate in another group",
            _count(numbers, "images_with_near_duplicate_elsewhere"),
        ),
        ("pairs of near-duplicates across groups", f"{numbers['near_duplicates_across_groups']:.0f}"),
    ]
    if "near_duplicates_leaking" in numbers:
        lines.append(("of them seen in training and scored", f"{numbers['near_duplicates_leaking']:.0f}"))
    return pd.DataFrame(lines, columns=["what", "value"])


def size_table(cases: pd.DataFrame, rows: int = 10) -> pd.DataFrame:
    """Tabulate the most common image sizes.

    Parameters
    ----------
    cases : pandas.DataFrame
        One row per case, as ``case_table`` makes them.
    rows : int, optional
        Maximum number of rows; further sizes share the last one.

    Returns
    -------
    pandas.DataFrame
        Columns ``size_px`` and ``images``.
    """
    import pandas as pd

    sizes = cases["width_px"].astype(str) + " x " + cases["height_px"].astype(str)
    counts = [(str(size), int(count)) for size, count in sizes.value_counts().items()]
    if len(counts) > rows:
        rest = counts[rows - 1 :]
        counts = [*counts[: rows - 1], (f"{len(rest)} others", sum(count for _, count in rest))]
    return pd.DataFrame(counts, columns=["size_px", "images"])


def pair_table(cases: pd.DataFrame, rows: int) -> pd.DataFrame:
    """Tabulate the pairs of images of different groups that are most alike, each image with its closest.

    Parameters
    ----------
    cases : pandas.DataFrame
        One row per case, as ``case_table`` makes them.
    rows : int
        Maximum number of pairs.

    Returns
    -------
    pandas.DataFrame
        One row per pair, the most alike first.
    """
    import pandas as pd

    known = cases[cases["closest_case"] != ""].sort_values("closest_correlation", ascending=False)
    columns = ["case_id", "group", "closest_case", "closest_group", "closest_correlation"]
    pairs: dict[frozenset[str], Any] = {}
    for row in known[columns].to_dict("records"):
        pairs.setdefault(frozenset((str(row["case_id"]), str(row["closest_case"]))), row)
    return pd.DataFrame(list(pairs.values())[:rows], columns=columns)


def describe(label: str, numbers: Mapping[str, float], duplicate_correlation: float) -> tuple[str, ...]:
    """State balance, groups, leakage and oddities.

    Parameters
    ----------
    label : str
        Name of the data set in sentences.
    numbers : Mapping[str, float]
        Metrics that ``metrics`` returns.
    duplicate_correlation : float
        Correlation of thumbnails above which images are near-duplicates.

    Returns
    -------
    tuple of str
        Sentences.
    """
    odd = ", ".join(f"{numbers[name]:.0f} {what}" for name, what in ODDITIES.items() if numbers[name])
    leaks = ""
    if "near_duplicates_leaking" in numbers:
        leaks = f", {numbers['near_duplicates_leaking']:.0f} of them with one seen in training and the other scored"
    return (
        f"{label}: {numbers['images']:.0f} images in {numbers['groups']:.0f} groups, "
        f"{_count(numbers, 'images_with_vessel')} with a vessel, which fills "
        f"{100 * numbers['vessel_share_median']:.1f} % of the image (median).",
        f"Near-duplicates across groups (correlation above {duplicate_correlation:g}): "
        f"{numbers['near_duplicates_across_groups']:.0f} pairs{leaks}.",
        f"Odd masks: {odd or 'none'}.",
    )


def contact_sheet(frames: LabelledFrames, label: str, images: int, seed: int) -> Figure:
    """Draw images with the outline of their masks, drawn at random evenly from all groups, sorted by group.

    Parameters
    ----------
    frames : LabelledFrames
        Images and masks.
    label : str
        Name of the data set in the title.
    images : int
        Maximum number of images.
    seed : int
        Seed of everything that is drawn at random.

    Returns
    -------
    Figure
        The figure.
    """
    from matplotlib.figure import Figure

    chosen = sample_evenly(frames.groups, images, seed)
    columns = min(COLUMNS, len(chosen))
    rows = -(-len(chosen) // columns)
    # Cells take the usual shape of the images, so that no space is lost between them.
    aspect = float(np.median([frames.images[i].shape[0] / frames.images[i].shape[1] for i in chosen]))
    figure = Figure(figsize=(2.4 * columns, (2.4 * aspect + 0.42) * rows + 0.4), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid:
        axes.axis("off")
    for axes, index in zip(grid, chosen, strict=False):
        _picture(axes, frames.images[index], frames.masks[index])
        share = frames.masks[index].mean()
        vessel = f"vessel {100 * share:.1f} %" if share else "no vessel"
        axes.set_title(
            f"{_short(frames.case_ids[index])}\n{_short(frames.groups[index])}, {vessel}", fontsize=7
        )
    figure.suptitle(f"{label}: {len(chosen)} of {len(frames)} images, mask outlined", fontsize="medium")
    return figure


def sample_evenly(groups: tuple[str, ...], count: int, seed: int) -> list[int]:
    """Draw cases at random, as evenly from the groups as possible.

    Parameters
    ----------
    groups : tuple of str
        Group of each case.
    count : int
        Maximum number of cases.
    seed : int
        Seed of everything that is drawn at random.

    Returns
    -------
    list of int
        Indices of the cases, in order of group.
    """
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(groups))
    # The number that each case has within its group, in random order, is the round in which it may be taken.
    taken: dict[str, int] = {}
    turn = np.zeros(len(groups), dtype=np.int64)
    for index in order:
        turn[index] = taken[groups[index]] = taken.get(groups[index], -1) + 1
    ranked = order[np.argsort(turn[order], kind="stable")][:count]
    return sorted((int(index) for index in ranked), key=lambda index: (groups[index], index))


def _picture(axes: Axes, image: np.ndarray, mask: np.ndarray) -> None:
    from PIL import Image

    scale = min(1.0, SHOWN_PX / max(image.shape))
    size = tuple(max(1, round(side * scale)) for side in image.shape[::-1])
    small = np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX))
    axes.imshow(small, cmap="gray", vmin=0, vmax=255)
    if mask.any():
        # A frame of background closes the outline of a vessel at the image's edge; coordinates are the small image's.
        down, across = (np.arange(-1, side + 1) for side in mask.shape)
        places = ((across + 0.5) * scale - 0.5, (down + 0.5) * scale - 0.5)
        axes.contour(*places, np.pad(mask, 1), levels=[0.5], colors=OUTLINE_COLOUR, linewidths=1.0)


def _spacing(cases: pd.DataFrame) -> str:
    known = cases.dropna(subset=["vertical_mm"])
    if not len(known):
        return "not known"
    sides = [
        f"{known[name].min():.4f} to {known[name].max():.4f} mm" for name in ("vertical_mm", "horizontal_mm")
    ]
    missing = f", not known of {len(cases) - len(known)}" if len(known) < len(cases) else ""
    return f"{sides[0]} down, {sides[1]} across{missing}"


def _count(numbers: Mapping[str, float], name: str) -> str:
    return f"{numbers[name]:.0f} ({100 * numbers[name] / numbers['images']:.0f} %)"


def _short(name: str, longest: int = 28) -> str:
    return name if len(name) <= longest else f"{name[:10]}…{name[-(longest - 11) :]}"
