"""All jobs of the study together: one decision for each network, data set and outer fold, and what is shown of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from experiments.analysis.consolidation.candidates import ENSEMBLE
from experiments.analysis.consolidation.certificate import Certificate, NonInferiority, page
from experiments.analysis.consolidation.figures import barrier_figure, reliability_figure
from experiments.analysis.consolidation.findings import (
    describe_ablation,
    describe_barriers,
    describe_calibration,
    describe_candidates,
    describe_certificate,
)
from experiments.analysis.consolidation.rows import BARRIER, CASE, SELECTION, TEST, of_kind, raw_cases
from experiments.analysis.consolidation.tables import (
    PLACE,
    ablation_table,
    barrier_table,
    calibration_table,
    candidates_table,
)
from experiments.analysis.consolidation.thresholds import STEPS
from experiments.analysis.segmentation.case_table import dataset_label, scores
from experiments.analysis.segmentation.summary import bounded_summary
from experiments.analysis.variants import varying_choices, with_choices
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome

if TYPE_CHECKING:
    import pandas as pd

# Settings that columns of their own tell apart.
COLUMNS = ("training_seed", "outer_fold", "seed", "init")


@dataclass(frozen=True)
class Decision:
    """The certificate of one network on one data set, in one outer fold.

    Parameters
    ----------
    network, dataset : str
        Names as tables have them.
    outer_fold : int or None
        Outer fold; None where folds are not nested.
    certificate : Certificate
        The decision.
    """

    network: str
    dataset: str
    outer_fold: int | None
    certificate: Certificate

    @property
    def where(self) -> str:
        """Network, data set and outer fold in words."""
        outer = "" if self.outer_fold is None else f", outer fold {self.outer_fold}"
        return f"{self.network} on {self.dataset}{outer}"


def pool(results: Sequence[JobResult]) -> pd.DataFrame:
    """Pool the rows of all jobs; networks with other settings get other names.

    Parameters
    ----------
    results : sequence of JobResult
        The jobs.

    Returns
    -------
    pandas.DataFrame
        Rows of all jobs.

    Raises
    ------
    InputError
        If no job has rows.
    """
    import pandas as pd

    names = named_jobs(results)
    parts = [
        result.cases.assign(network=names[place][0])
        for place, result in enumerate(results)
        if place in names and result.cases is not None
    ]
    if not parts:
        raise InputError("results: expected at least one job with rows, received none")
    return pd.concat(parts, ignore_index=True)


def named_jobs(results: Sequence[JobResult]) -> dict[int, tuple[str, str]]:
    """Name network and data set of each job, as the pooled rows have them.

    Parameters
    ----------
    results : sequence of JobResult
        The jobs.

    Returns
    -------
    dict
        Network, with the settings in which it differs from others of its name, and data set, marked if simulated, by
        the place of the job; jobs without rows are left out.
    """
    kept = {place: result.cases.iloc[0] for place, result in enumerate(results) if result.cases is not None}
    labels = [
        (str(row["network"]), dataset_label(str(row["dataset"]), bool(row["simulated"])))
        for row in kept.values()
    ]
    varying = varying_choices([results[place] for place in kept], labels, COLUMNS)
    return {
        place: (with_choices(network, choices), dataset)
        for place, (network, dataset), choices in zip(kept, labels, varying, strict=True)
    }


def data_of(cases: pd.DataFrame) -> list[dict[str, str]]:
    """List the data sets of all jobs.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all jobs.

    Returns
    -------
    list of dict
        ``name``, ``digest`` and ``licence`` of each.
    """
    found = cases[["dataset", "data_digest", "data_licence"]].drop_duplicates()
    return [
        {"name": str(name), "digest": str(digest), "licence": str(licence)}
        for name, digest, licence in found.itertuples(index=False)
    ]


def decisions(cases: pd.DataFrame, rule: NonInferiority) -> tuple[Decision, ...]:
    """Decide for each network, data set and outer fold, over all its seeds.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all jobs.
    rule : NonInferiority
        The rule.

    Returns
    -------
    tuple of Decision
        The decisions. With nested folds each outer fold has its own, since the selection groups of one are the test
        groups of another.
    """
    found = []
    chosen_on = raw_cases(cases, SELECTION)
    for (network, dataset, simulated, _), part in chosen_on.groupby([*PLACE, "outer_fold"], sort=False):
        label = dataset_label(str(dataset), bool(simulated))
        outer = int(part["outer_fold"].iloc[0])
        found.append(Decision(str(network), label, None if outer < 0 else outer, rule(part)))
    return tuple(found)


def consolidated_cases(cases: pd.DataFrame, decided: Sequence[Decision]) -> pd.DataFrame:
    """Select the test scores of the models that were decided on, with their thresholds and morphology.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of all jobs.
    decided : sequence of Decision
        The decisions.

    Returns
    -------
    pandas.DataFrame
        One row for each test case and job.
    """
    import pandas as pd

    final = of_kind(cases, CASE, part=TEST, step=STEPS[-1])
    labels = [
        dataset_label(str(d), bool(s)) for d, s in zip(final["dataset"], final["simulated"], strict=True)
    ]
    parts = []
    for one in decided:
        outer = -1 if one.outer_fold is None else one.outer_fold
        own = (final["network"] == one.network) & (final["outer_fold"] == outer)
        own &= (final["model"] == one.certificate.consolidated) & (
            pd.Series(labels, index=final.index) == one.dataset
        )
        parts.append(final[own])
    return pd.concat(parts, ignore_index=True).assign(model="consolidated model")


def overview(cases: pd.DataFrame, decided: Sequence[Decision], calibration: str) -> Outcome:
    """Make metrics, tables, figures and findings of one job or of all.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the jobs.
    decided : sequence of Decision
        What was decided on them.
    calibration : str
        Calibration that thresholds were chosen behind.

    Returns
    -------
    Outcome
        The outcome; metrics are those of the consolidated model on test groups.
    """
    named = tuple(dict.fromkeys([ENSEMBLE, *(one.certificate.consolidated for one in decided)]))
    tables = {
        "candidates": candidates_table(cases),
        "ablation": ablation_table(cases, named),
        "calibration": calibration_table(cases),
    }
    findings = [describe_certificate(one.certificate, one.where) for one in decided]
    findings += [*describe_candidates(tables["candidates"]), *describe_ablation(tables["ablation"])]
    findings += describe_calibration(tables["calibration"], calibration, named)
    figures = {"reliability": reliability_figure(cases, named, calibration)}
    if (cases["kind"] == BARRIER).any():
        tables["barriers"] = barrier_table(cases)
        findings += describe_barriers(tables["barriers"])
        figures["barriers"] = barrier_figure(cases)
    return Outcome(
        metrics=consolidated_metrics(cases, decided),
        cases=cases,
        tables=tables,
        figures=figures,
        findings=tuple(findings),
    )


def consolidated_metrics(cases: pd.DataFrame, decided: Sequence[Decision]) -> dict[str, float]:
    """Summarise the test scores of the consolidated model of one network on one data set.

    Parameters
    ----------
    cases : pandas.DataFrame
        Rows of the jobs.
    decided : sequence of Decision
        What was decided on them.

    Returns
    -------
    dict
        Scalars by the name of the metric; none for several networks or data sets, which have no such name in common.
    """
    if len({(one.network, one.dataset) for one in decided}) > 1:
        return {}
    final = consolidated_cases(cases, decided)
    numbers = bounded_summary(
        final[["model", "dataset", "simulated", "group", "case_id", "seed", "outer_fold", *scores(final)]]
    )
    return numbers | {"certified": float(all(one.certificate.certified for one in decided))}


def certificate_pages(decided: Sequence[Decision], about: Mapping[str, Any]) -> str:
    """Write the certificates of all decisions as one page.

    Parameters
    ----------
    decided : sequence of Decision
        The decisions.
    about : mapping
        What ``Certificate.block`` takes further.

    Returns
    -------
    str
        Markdown.
    """
    pages = [(one.where, page(one.certificate.block(**about))) for one in decided]
    if len(pages) == 1:
        return pages[0][1]
    return "\n".join(
        text.replace("# Certificate of the consolidated model", f"# {where}", 1) for where, text in pages
    )
