"""What tracked runs tell of the items of CLAIM 2024."""

from __future__ import annotations

from typing import TYPE_CHECKING

from experiments.studies.checklist.claim_items import ITEMS, SOURCE
from experiments.studies.checklist.facts import Facts, mean_with_interval, rate_with_interval
from experiments.studies.checklist.items import Checklist, Filling

if TYPE_CHECKING:
    import pandas as pd

METRICS = {
    "dsc": "Dice similarity coefficient over cases whose reference is not empty; a missed vessel scores 0",
    "hd95_mm": "the larger directed 95th percentile between boundary pixels in mm; a missed vessel scores the diagonal",
    "hd95_px": "the larger directed 95th percentile in px, where the spacing is not known; missed: the diagonal",
    "missed": "an empty prediction where the reference is not empty",
    "false_alarm": "a prediction where the reference is empty",
}
DATASETS = ("dataset", "first", "second")
WORST = 5


def _sources(facts: Facts) -> Filling:
    told = list(facts.settings(*DATASETS))
    told += [f"digest of {name}: {digest[:16]}" for name, digest in facts.digests.items()]
    licences = {
        str(each)
        for table in facts.tables
        if "data_licence" in table
        for each in table["data_licence"].dropna()
    }
    told += [f"licence: {', '.join(sorted(licences))}"] if licences else []
    if facts.simulated():
        told.append("all cases are simulated")
    left = "" if facts.simulated() else "place, dates and how the data were made available"
    return Filling(tuple(told), left)


def _subsets(facts: Facts) -> Filling:
    names = ("subset", "prune_by", "subsample_to", "district")
    told = [f"dataset.{name}={value}" for name in names for value in facts.values(f"dataset.{name}")]
    return Filling(tuple(told), "why this part" if told else "")


def _missing(facts: Facts) -> Filling:
    told = tuple(
        f"images or masks without their counterpart: {value}" for value in facts.values("dataset.unpaired")
    )
    return Filling(told, "how many there were" if told else "")


def _acquisition(facts: Facts) -> Filling:
    if not facts.simulated():
        return Filling()
    return Filling((*facts.settings("dataset", "phantom"), "simulated: no patient was imaged"))


def _reference(facts: Facts) -> Filling:
    told = ("exact masks of the simulated anatomy",) if facts.simulated() else ()
    return Filling(told)


def _assignment(facts: Facts) -> Filling:
    told = list(facts.settings("split"))
    folds = sorted(
        {str(fold) for table in facts.tables if "fold" in table for fold in table["fold"].dropna()}
    )
    told += [f"folds scored: {', '.join(folds)}"] if folds else []
    return Filling(tuple(told))


def _disjoint(facts: Facts) -> Filling:
    told = [leakage(table) for table in facts.tables if {"group", "fold"} <= {*table}]
    notes = [f"note of the data set: {note}" for note in facts.tags("notes")]
    left = "whether groups are patients, where the data set does not say" if told else ""
    return Filling((*dict.fromkeys(told), *notes), left)


def leakage(table: pd.DataFrame) -> str:
    """Check in a table of cases that no group is in two partitions.

    Parameters
    ----------
    table : pandas.DataFrame
        Cases with ``group``, ``fold`` and, where groups were set aside, ``part``; ``seed`` and ``outer_fold`` tell
        divisions apart.

    Returns
    -------
    str
        How many groups there are, and whether any is in two folds or both in and outside of the folds.
    """
    cases = table.assign(part=table.get("part", "out_of_fold"))
    division = [name for name in ("seed", "outer_fold", "model", "train_dataset", "dataset") if name in cases]
    inside = cases[cases["part"] == "out_of_fold"]
    if "train_dataset" in cases:
        # Data that nothing was trained on are scored by the networks of all folds.
        inside = inside[inside["train_dataset"] == inside["dataset"]]
    folds = inside.groupby([*division, "group"], dropna=False)["fold"].nunique()
    parts = cases.groupby([*division, "group"], dropna=False)["part"].nunique()
    wrong = int((folds > 1).sum() + (parts > 1).sum())
    found = (
        "no group is scored in two folds or parts of one division"
        if not wrong
        else f"{wrong} groups are in two"
    )
    return (
        f"partitions are divided by group, {cases['group'].nunique()} groups; checked in the cases: {found}"
    )


def _software(facts: Facts) -> Filling:
    told = [", ".join(facts.packages())] if facts.packages() else []
    told += [f"Python {', '.join(found)}"] if (found := facts.tags("ctus.python")) else []
    told += [f"code at commit {', '.join(found)}"] if (found := facts.commits()) else []
    told += [f"machine: {found}" for found in facts.tags("ctus.machine")]
    return Filling(tuple(told))


def _start(facts: Facts) -> Filling:
    told = [*facts.settings("init"), *(f"start: {source}" for source in facts.tags("start_source"))]
    return Filling(tuple(told))


def _training(facts: Facts) -> Filling:
    told = [*facts.settings("trainer", "loss", "augmentation", "distillation")]
    seeds = dict.fromkeys(str(config["seed"]) for config in facts.configs if config.get("seed") is not None)
    told += [f"seeds: {', '.join(seeds)}"] if told and seeds else []
    return Filling(tuple(told))


def _choice(facts: Facts) -> Filling:
    names = ("selection", "selection_epochs", "late_weights", "patience")
    told = [
        f"trainer.{name}: {', '.join(found)}" for name in names if (found := facts.values(f"trainer.{name}"))
    ]
    told += [f"consolidated model: {', '.join(found)}"] if (found := facts.tags("consolidated")) else []
    return Filling(tuple(told))


def _ensembles(facts: Facts) -> Filling:
    found = facts.tags("consolidated")
    return Filling(tuple(f"from the networks of all folds: {each}" for each in found))


def _metrics(facts: Facts) -> Filling:
    told = [
        f"{name}: {text}" for name, text in METRICS.items() if any(name in table for table in facts.tables)
    ]
    return Filling(tuple(told))


def _statistics(facts: Facts) -> Filling:
    if not any("dsc" in table for table in facts.tables):
        return Filling()
    told = [
        "95 % intervals by bootstrap over groups (the unit is the group, never the frame); rates with Wilson's"
    ]
    tested = any(
        str(name).endswith("_p_holm")
        for family in facts.families
        for name in {*family.run.history["metric"], *family.run.metrics}
    )
    if tested:
        told.append("models compared by the exact signed-rank test of group means, with Holm's adjustment")
    return Filling(tuple(told), "" if tested else "tests of differences, where any is claimed")


def _sensitivity(facts: Facts) -> Filling:
    seeds = sorted(
        {str(seed) for table in facts.tables if "seed" in table for seed in table["seed"].dropna()}
    )
    told = (f"repeated with the seeds {', '.join(seeds)}",) if len(seeds) > 1 else ()
    return Filling(told, "sensitivity to images of other scanners or quality" if told else "")


def _internal(facts: Facts) -> Filling:
    told = [
        f"{name}: {cases['case_id'].nunique()} cases of {cases[unit].nunique()} {unit}s, each scored by networks "
        "that have not seen its group"
        for name, cases, unit in facts.parts("dsc")
        if {"case_id", "fold"} <= {*cases} and "train_dataset" not in cases
    ]
    return Filling(tuple(told))


def _external(facts: Facts) -> Filling:
    told = [
        f"trained on {cases['train_dataset'].iloc[0]}, tested on {cases['dataset'].iloc[0]}: "
        f"{mean_with_interval(cases, 'dsc', unit)}"
        for _, cases, unit in facts.parts("dsc")
        if {"train_dataset", "dataset"} <= {*cases} and (cases["train_dataset"] != cases["dataset"]).all()
    ]
    return Filling(tuple(told))


def _numbers(facts: Facts) -> Filling:
    told = []
    for name, cases, unit in facts.parts("missed"):
        if "case_id" in cases:
            told.append(
                f"{name}: {cases['case_id'].nunique()} cases with a vessel of {cases[unit].nunique()} {unit}s"
            )
    return Filling(
        tuple(told), "numbers excluded and why; patients, where groups are not patients" if told else ""
    )


def _performance(facts: Facts) -> Filling:
    told = [
        f"{name}: {mean_with_interval(cases, metric, unit)}"
        for metric in ("dsc", "hd95_mm", "hd95_px")
        for name, cases, unit in facts.parts(metric)
    ]
    return Filling(tuple(told))


def _diagnostic(facts: Facts) -> Filling:
    told = [
        f"{name}: {rate_with_interval(cases, metric, unit)}"
        for metric in ("missed", "false_alarm")
        for name, cases, unit in facts.parts(metric)
    ]
    return Filling(tuple(told), "performance for a clinical question, where there is one" if told else "")


def _failures(facts: Facts) -> Filling:
    told = []
    for name, cases, _ in facts.parts("dsc"):
        if "case_id" in cases:
            worst = cases.groupby("case_id")["dsc"].mean().nsmallest(WORST)
            told.append(
                f"{name}: lowest DSC " + ", ".join(f"{case} {value:.2f}" for case, value in worst.items())
            )
    return Filling(tuple(told), "what these cases have in common" if told else "")


def _detail(facts: Facts) -> Filling:
    told = [
        f"run {family.run.run_id}: resolved configuration, metrics and cases" for family in facts.families
    ]
    return Filling(tuple(told), "a protocol")


def _available(facts: Facts) -> Filling:
    told = [f"code at commit {', '.join(found)}"] if (found := facts.commits()) else []
    return Filling(tuple(told), "where code, trained model and data can be had" if told else "")


def claim() -> Checklist:
    """Make the checklist with its fillers.

    Returns
    -------
    Checklist
        CLAIM 2024.
    """
    fillers = {
        "1": lambda facts: Filling(facts.settings("model"), "title and abstract themselves"),
        "7": _sources,
        "9": lambda facts: Filling(facts.settings("preprocessing")),
        "10": _subsets,
        "12": _missing,
        "13": _acquisition,
        "14": _reference,
        "19": _assignment,
        "20": _disjoint,
        "22": lambda facts: Filling(facts.settings("model", "width", "normalisation", "image_size_px")),
        "23": _software,
        "24": _start,
        "25": _training,
        "26": _choice,
        "27": _ensembles,
        "28": _metrics,
        "29": _statistics,
        "30": _sensitivity,
        "32": _internal,
        "33": _external,
        "35": _numbers,
        "37": _performance,
        "38": _diagnostic,
        "39": _failures,
        "42": _detail,
        "43": _available,
    }
    return Checklist("CLAIM 2024", SOURCE, ITEMS, fillers)
