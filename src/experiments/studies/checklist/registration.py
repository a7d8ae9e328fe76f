"""The items of registration accuracy, and what tracked runs tell of them."""

from __future__ import annotations

from experiments.studies.checklist.facts import Facts, mean_with_interval, rate_with_interval
from experiments.studies.checklist.items import Checklist, Filling, Item
from registration.metrics.surface_distance import SUCCESS_TRE_MM

SOURCE = (
    "J. M. Fitzpatrick and J. B. West, IEEE Transactions on Medical Imaging 20, 2001 (target registration error); "
    "P. Jannin et al., International Journal of CARS 1, 2006 (reporting of validation); K. K. Brock et al., report of "
    "AAPM task group 132, Medical Physics 44, 2017; the numbers are ours"
)
_WHAT, _WHOM, _FOUND, _REST = "What was measured", "On whom", "What was found", "What it rests on"
ITEMS = (
    Item("R1", _WHAT, "What is registered to what, and by which method with which settings"),
    Item("R2", _WHAT, "From which initial poses, with which disturbances"),
    Item("R3", _WHAT, "Which errors, and at which targets"),
    Item("R4", _WHAT, "What counts as a success, and why for this use"),
    Item("R5", _WHOM, "Subjects, phantoms or anatomies, and how they were chosen"),
    Item("R6", _WHOM, "Numbers, and which unit is independent"),
    Item("R7", _FOUND, "The distribution of the error, with its tail"),
    Item("R8", _FOUND, "Rates with intervals over the independent unit"),
    Item("R9", _FOUND, "Failure analysis: how many, which, and how they enter the numbers"),
    Item("R10", _FOUND, "Whether the method knows: accepted results, and wrong ones among them"),
    Item("R11", _FOUND, "Runtime, and on which machine"),
    Item("R12", _REST, "The reference, and how accurate it is"),
    Item("R13", _REST, "Whether any case tested was used to develop or tune (leakage)"),
    Item("R14", _REST, "Whether tissue deforms, and whether that is in the error"),
    Item("R15", _REST, "Code, packages and data, so that it can be repeated"),
)
ERRORS = ("tre_mm", "rmse_mm", "hd95_covered_mm", "msd_mm", "rotation_error_deg", "translation_error_mm")
LEVELS = ("factor", "rotation", "overlap", "place", "noise_mm", "outlier_share", "missing_share", "block")


def _method(facts: Facts) -> Filling:
    told = facts.settings("rigid", "deformable", "target", "moving", "fixed", "phantoms", "masks")
    return Filling(told, "modalities and the clinical task" if told else "")


def _disturbed(facts: Facts) -> Filling:
    told = list(facts.settings("perturbation"))
    for table in facts.tables:
        told += [
            f"{name}: {', '.join(str(value) for value in table[name].dropna().unique()[:12])}"
            for name in LEVELS
            if name in table and table[name].nunique() > 1
        ]
        told += [
            f"{name} {table[name].min():.3g} to {table[name].max():.3g}"
            for name in ("angle_deg", "translation_mm")
            if name in table and table[name].notna().any()
        ]
    return Filling(tuple(dict.fromkeys(told)))


def _errors(facts: Facts) -> Filling:
    told = [name for name in ERRORS if any(name in table for table in facts.tables)]
    said = [f"errors: {', '.join(told)}"] if told else []
    numbers = facts.tags("tre_targets_n")
    said += [f"targets: {kind}" for kind in facts.tags("tre_targets")]
    said += [f"number of targets: {', '.join(numbers)}"] if numbers else []
    return Filling(tuple(said), "" if numbers or not said else "the targets")


def _success(facts: Facts) -> Filling:
    used = any("success_tre" in table for table in facts.tables)
    told = (f"success_tre: a TRE of at most {SUCCESS_TRE_MM:g} mm",) if used else ()
    return Filling(told, "why this is enough for the use" if told else "")


def _whom(facts: Facts) -> Filling:
    told = []
    for table in facts.tables:
        for unit in ("anatomy", "phantom", "group"):
            if unit in table:
                names = [str(name) for name in table[unit].dropna().unique()]
                told.append(f"{unit}: {', '.join(names[:12])}{', ...' if len(names) > 12 else ''}")
                break
    if facts.simulated():
        told.append("simulated")
    return Filling(
        tuple(dict.fromkeys(told)), "how they were chosen, and patients' characteristics" if told else ""
    )


def _counts(facts: Facts) -> Filling:
    told = [
        f"{name}: {len(cases)} rows on {cases[unit].nunique()} {unit}(s), which are the independent unit"
        for name, cases, unit in facts.parts(_main(facts))
    ]
    return Filling(tuple(told))


def _distribution(facts: Facts) -> Filling:
    told = []
    for metric in ERRORS:
        for name, cases, _ in facts.parts(metric):
            values = cases[metric].astype(float)
            told.append(
                f"{name}: {metric} median {values.median():.3g}, 95th percentile "
                f"{values.quantile(0.95, interpolation='higher'):.3g}, largest {values.max():.3g}"
            )
    return Filling(tuple(told))


def _rates(facts: Facts) -> Filling:
    told = [
        f"{name}: {rate_with_interval(cases, metric, unit)}"
        for metric in ("success_tre", "success")
        for name, cases, unit in facts.parts(metric)
    ]
    if not told:
        told = [
            f"{name}: {mean_with_interval(cases, metric, unit)}"
            for metric in ERRORS
            for name, cases, unit in facts.parts(metric)
        ]
    return Filling(tuple(told))


def _failed(facts: Facts) -> Filling:
    told = []
    for name, cases, _ in facts.parts("success_tre"):
        lost = cases[~cases["success_tre"].astype(bool)]
        without = int((lost["tre_mm"].astype(float) == float("inf")).sum()) if "tre_mm" in lost else 0
        told.append(
            f"{name}: {len(lost)} of {len(cases)} over {SUCCESS_TRE_MM:g} mm, of which {without} without a result; "
            "these count as infinite errors"
        )
        if "error" in lost and (lost["error"].astype(str).str.len() > 0).any():
            reasons = lost["error"].astype(str).value_counts()
            told.append(
                f"{name}: {', '.join(f'{text} ({count})' for text, count in reasons.head(3).items() if text)}"
            )
    return Filling(tuple(told), "what the failures have in common" if told else "")


def _judged(facts: Facts) -> Filling:
    told = []
    for name, cases, unit in facts.parts("success_tre"):
        if "accepted" in cases:
            accepted = cases[cases["accepted"].astype(bool)]
            text = f"{name}: {len(accepted)} of {len(cases)} accepted"
            told.append(
                f"{text}; among these {rate_with_interval(accepted, 'success_tre', unit)}"
                if len(accepted)
                else text
            )
    return Filling(tuple(told))


def _runtime(facts: Facts) -> Filling:
    told = [
        f"{name}: median {cases['runtime_s'].astype(float).median():.3g} s"
        for name, cases, _ in facts.parts("runtime_s")
    ]
    machines = facts.tags("ctus.machine")
    return Filling(tuple([*told, *(f"machine: {machine}" for machine in machines)] if told else ()))


def _truth(facts: Facts) -> Filling:
    told = (
        ("the pose is known exactly: the moving cloud is moved or simulated with it",)
        if _drawn(facts)
        else ()
    )
    return Filling(told)


def _drawn(facts: Facts) -> bool:
    """Whether the truth is made: trials of a perturbation, or simulated sweeps."""
    disturbed = any(config.get("perturbation") and not config.get("moving") for config in facts.configs)
    return disturbed or facts.simulated() is True


def _leaks(facts: Facts) -> Filling:
    told = tuple(f"subset of the frozen cases: {value}" for value in facts.values("subset"))
    return Filling(told, "on which cases the method's settings were chosen" if told else "")


def _deforms(facts: Facts) -> Filling:
    told = [*facts.settings("deformable")]
    blocks = {str(name) for table in facts.tables if "block" in table for name in table["block"].dropna()}
    told += [f"blocks of cases: {', '.join(sorted(blocks))}"] if blocks else []
    return Filling(tuple(told))


def _again(facts: Facts) -> Filling:
    told = [f"run {family.run.run_id}" for family in facts.families]
    told += [f"code at commit {', '.join(found)}"] if (found := facts.commits()) else []
    told += [", ".join(facts.packages())] if facts.packages() else []
    told += [f"digest of {name}: {digest[:16]}" for name, digest in facts.digests.items()]
    return Filling(tuple(told), "" if facts.digests else "the contents of the data")


def _main(facts: Facts) -> str:
    return next((name for name in ERRORS if any(name in table for table in facts.tables)), ERRORS[0])


def registration_accuracy() -> Checklist:
    """Make the checklist with its fillers.

    Returns
    -------
    Checklist
        The items of registration accuracy.
    """
    fillers = (
        *(_method, _disturbed, _errors, _success, _whom, _counts, _distribution, _rates, _failed, _judged),
        *(_runtime, _truth, _leaks, _deforms, _again),
    )
    numbers = [item.number for item in ITEMS]
    return Checklist("Registration accuracy", SOURCE, ITEMS, dict(zip(numbers, fillers, strict=True)))
