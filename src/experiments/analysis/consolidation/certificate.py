"""Which model the folds become, by a test of non-inferiority on selection groups, and the page that says so."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from experiments.analysis.consolidation.candidates import AVERAGES, DISTILLED, ENSEMBLE
from experiments.analysis.segmentation.case_table import once_each
from experiments.errors import InputError
from experiments.statistics import Bootstrap, by_unit

if TYPE_CHECKING:
    import pandas as pd

AVERAGE_KIND, DISTILLED_KIND, ENSEMBLE_KIND = "averaged network", "distilled network", "ensemble of folds"


@dataclass(frozen=True)
class Comparison:
    """A single network against the ensemble of folds on selection groups.

    Parameters
    ----------
    candidate : str
        Name of the network.
    dsc_mean, ensemble_dsc_mean : float
        Mean DSC over groups of either, 0 to 1.
    difference : float
        Mean difference of the DSC over groups, candidate less ensemble.
    lower_bound : float
        One-sided bootstrap bound of the difference; NaN where there are too few groups for one.
    confidence : float
        Its confidence level.
    missed, ensemble_missed, false_alarms, ensemble_false_alarms : float
        Missed vessels and false alarms of either; means over seeds.
    passes : bool
        Whether the bound lies above the margin.
    """

    candidate: str
    dsc_mean: float
    ensemble_dsc_mean: float
    difference: float
    lower_bound: float
    confidence: float
    missed: float
    ensemble_missed: float
    false_alarms: float
    ensemble_false_alarms: float
    passes: bool


@dataclass(frozen=True)
class Certificate:
    """Decision between an averaged network, a distilled one and the ensemble of folds.

    Parameters
    ----------
    consolidated : str
        Name of the candidate that was chosen.
    kind : str
        ``averaged network``, ``distilled network`` or ``ensemble of folds``.
    certified : bool
        Whether a single network was shown to be non-inferior to the ensemble.
    reason : str
        Why, in one sentence.
    comparisons : tuple of Comparison
        Single networks against the ensemble, in the order in which they were tried.
    groups, images, seeds : int
        Number of selection groups and images with a vessel, and of seeds.
    margin : float
        Largest loss of DSC that is accepted.
    """

    consolidated: str
    kind: str
    certified: bool
    reason: str
    comparisons: tuple[Comparison, ...]
    groups: int
    images: int
    seeds: int
    margin: float

    def block(self, **about: Any) -> dict[str, Any]:
        """Return the certificate as plain values, as a model file holds it.

        Parameters
        ----------
        **about : Any
            Further plain values, such as what the data are.

        Returns
        -------
        dict
            Fields by name, ``comparisons`` as a list of mappings.
        """
        return {**asdict(self), "comparisons": [asdict(each) for each in self.comparisons], **about}


@dataclass(frozen=True)
class NonInferiority:
    """Choice of one network where it is shown to be not worse than the ensemble, else of the ensemble.

    Of the averaged networks the one of highest DSC is tested first, then the distilled one.

    Parameters
    ----------
    margin : float, optional
        Largest loss of DSC that is accepted, above 0.
    alpha : float, optional
        Probability of certifying a network that is worse by more than the margin, at most; shared equally by all single
        networks, since the best of several is looked at.
    min_seeds : int, optional
        Smallest number of seeds.
    min_groups : int, optional
        Smallest number of selection groups with a vessel; the bootstrap of fewer is too narrow.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    margin: float = 0.01
    alpha: float = 0.05
    min_seeds: int = 3
    min_groups: int = 5

    def __post_init__(self) -> None:
        if not 0 < self.margin < 1:
            raise InputError(f"margin: expected a DSC above 0 and below 1, received {self.margin}")
        if not 0 < self.alpha < 0.5:
            raise InputError(f"alpha: expected a probability above 0 and below 0.5, received {self.alpha}")
        for name, least in (("min_seeds", 1), ("min_groups", 2)):
            if getattr(self, name) < least:
                raise InputError(f"{name}: expected at least {least}, received {getattr(self, name)}")

    def __call__(self, cases: pd.DataFrame) -> Certificate:
        """Decide by the scores of selection groups.

        Parameters
        ----------
        cases : pandas.DataFrame
            One row for each selection case, seed and candidate (column ``model``), scored at a threshold of 0.5.

        Returns
        -------
        Certificate
            The decision.

        Raises
        ------
        InputError
            If the ensemble was not scored, or a candidate not on the same cases.
        """
        if not (cases["model"] == ENSEMBLE).any():
            raise InputError(f"cases: expected rows of the {ENSEMBLE}, received none")
        ensemble = cases[cases["model"] == ENSEMBLE]
        vessels = ensemble.dropna(subset="dsc")
        seeds, groups = int(ensemble["seed"].nunique()), int(vessels["group"].nunique())
        tried = [name for name in (*AVERAGES, DISTILLED) if (cases["model"] == name).any()]
        confidence = 1 - self.alpha / max(len(tried), 1)
        compared = {name: self._compared(cases, name, confidence) for name in tried}
        best = sorted(
            (name for name in tried if name in AVERAGES), key=lambda name: -compared[name].difference
        )
        order = [*best[:1], *(name for name in tried if name == DISTILLED)]
        shortage = self._shortage(seeds, groups)
        chosen = next((name for name in order if compared[name].passes), None) if not shortage else None
        reason = self._reason(chosen, shortage, [compared[name] for name in order])
        return Certificate(
            chosen or ENSEMBLE,
            ENSEMBLE_KIND if chosen is None else DISTILLED_KIND if chosen == DISTILLED else AVERAGE_KIND,
            chosen is not None,
            reason,
            tuple(compared[name] for name in (*order, *best[1:])),
            groups,
            int(vessels["case_id"].nunique()),
            seeds,
            self.margin,
        )

    def _compared(self, cases: pd.DataFrame, name: str, confidence: float) -> Comparison:
        own, other = (cases[cases["model"] == each] for each in (name, ENSEMBLE))
        scored = [set(map(tuple, each[["seed", "case_id"]].to_numpy().tolist())) for each in (own, other)]
        if scored[0] != scored[1]:
            raise InputError(
                f"cases: expected {name} on the cases and seeds of the {ENSEMBLE}, received others"
            )
        first, second = (by_unit(once_each(each), "dsc") for each in (own, other))
        differences = (first - second).to_numpy()
        bound = math.nan
        if len(differences) >= self.min_groups:
            bound = Bootstrap(level=2 * confidence - 1)(differences).low
        missed, ensemble_missed, false_alarms, ensemble_false_alarms = (
            float(each.groupby("seed")[column].sum().mean())
            for column in ("missed", "false_alarm")
            for each in (own, other)
        )
        difference = float(differences.mean()) if len(differences) else math.nan
        return Comparison(
            name,
            float(first.mean()),
            float(second.mean()),
            difference,
            float(bound),
            confidence,
            missed,
            ensemble_missed,
            false_alarms,
            ensemble_false_alarms,
            bool(bound > -self.margin),
        )

    def _shortage(self, seeds: int, groups: int) -> str:
        """What there is too little of for a certificate."""
        if groups < self.min_groups:
            return f"not certified: n = {groups} groups, a bootstrap over groups needs at least {self.min_groups}"
        if seeds < self.min_seeds:
            return f"not certified: n = {seeds} seed{'s' if seeds != 1 else ''}, at least {self.min_seeds} are needed"
        return ""

    def _reason(self, chosen: str | None, shortage: str, tried: Sequence[Comparison]) -> str:
        if shortage:
            return f"{shortage}; the {ENSEMBLE} is used."
        words = [
            f"{each.candidate} {each.difference:+.4f} DSC ({100 * each.confidence:.1f} % bound {each.lower_bound:+.4f})"
            for each in tried
        ]
        if chosen is None:
            said = "; ".join(words) if words else "no single network was tried"
            return f"no single network was shown to lose at most {self.margin:g} DSC: {said}; the {ENSEMBLE} is used."
        passed = next(word for word, each in zip(words, tried, strict=True) if each.candidate == chosen)
        return f"not worse than the {ENSEMBLE} by more than {self.margin:g} DSC: {passed}."


def page(block: Mapping[str, Any]) -> str:
    """Write a certificate as Markdown.

    Parameters
    ----------
    block : mapping
        As ``Certificate.block`` gives it, with ``data`` where known: mappings with ``name``, ``digest``, ``licence``.

    Returns
    -------
    str
        The page.
    """
    lines = [
        "# Certificate of the consolidated model",
        "",
        f"Model: **{block['consolidated']}** ({block['kind']}), "
        f"{'certified' if block['certified'] else 'not certified as one network'}.",
        "",
        f"Why: {block['reason']}",
        "",
        f"On whom: {block['images']} images with a vessel of {block['groups']} selection groups, {block['seeds']} "
        f"seed{'s' if block['seeds'] != 1 else ''}. No test group was looked at. Means are over groups, after seeds "
        f"and images; masks at a probability of 0.5; margin {block['margin']:g} DSC, one-sided bootstrap over groups, "
        "its level shared by all single networks.",
        "",
    ]
    for each in block.get("data", ()):
        lines.append(f"Data: {each['name']}, {each['licence']}, SHA-256 `{each['digest']}`.")
    lines += [
        "",
        "| network | DSC | ensemble | difference | lower bound | level | missed | false alarms | passes |",
    ]
    lines.append("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for each in block["comparisons"]:
        bound = "too few groups" if math.isnan(each["lower_bound"]) else f"{each['lower_bound']:+.4f}"
        lines.append(
            f"| {each['candidate']} | {each['dsc_mean']:.4f} | {each['ensemble_dsc_mean']:.4f} | "
            f"{each['difference']:+.4f} | {bound} | {100 * each['confidence']:.2f} % | "
            f"{each['missed']:.1f} ({each['ensemble_missed']:.1f}) | "
            f"{each['false_alarms']:.1f} ({each['ensemble_false_alarms']:.1f}) | {'yes' if each['passes'] else 'no'} |"
        )
    return "\n".join(lines) + "\n\nIn brackets: those of the ensemble; mean number a seed.\n"
