"""The frozen benchmark of rigid registration: simulated sweeps of random anatomies, solved and scored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.registration.benchmark.cases import (
    DEFAULT_FOLDER,
    block_specs,
    frozen_digests,
    make_cases,
)
from experiments.analysis.registration.benchmark.figures import benchmark_figures
from experiments.analysis.registration.benchmark.findings import describe_benchmark
from experiments.analysis.registration.benchmark.metrics import benchmark_metrics
from experiments.analysis.registration.benchmark.tables import benchmark_tables
from experiments.analysis.variants import distinct_names
from experiments.errors import InputError, require_count
from experiments.inputs.surfaces import one_method
from experiments.outcome import InputData, JobResult, Outcome, Progress
from experiments.paths import project_root
from experiments.process_pool import process_pool
from experiments.studies.rigid_benchmark.trial import BenchmarkTrial
from registration.benchmark.blocks import collection_name
from registration.benchmark.cases import UNDEFORMED

if TYPE_CHECKING:
    import pandas as pd

    from registration.benchmark.blocks import CaseSpec

PER_CASE = "rigid_benchmark.csv"
# What the dashboard has columns for.
HEADLINE = (
    *("success_tre_rate", "success_tre_rate_low", "success_tre_rate_high", "success_rate", "acceptance_rate"),
    *("accepted_wrong_rate", "interval_coverage_rate", "tre_mm_median", "tre_mm_p95", "rmse_mm_median"),
    *("runtime_s_median", "cases", "cases_without_result"),
)


def jobs(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """List one job for each method.

    Parameters
    ----------
    config : Mapping[str, Any]
        Configuration of the sweep point.

    Returns
    -------
    list of dict
        What each job changes in the configuration.

    Raises
    ------
    InputError
        If ``rigid`` names no method.
    """
    methods = config.get("rigid")
    if not isinstance(methods, Mapping) or not methods:
        raise InputError(f"rigid: expected at least one method, received {methods!r}")
    return [{"rigid": {name: settings}} for name, settings in methods.items()]


def check(
    *,
    subset: str,
    blocks: Sequence[str],
    rigid: Mapping[str, Any],
    cases: int | None,
    workers: int,
    root: str | None,
) -> None:
    """Check that the subset and its blocks exist and that the settings allow cases.

    Parameters
    ----------
    subset : str
        ``development``, ``test`` or ``symmetric``.
    blocks : sequence of str
        Blocks of cases: ``undeformed``, ``deforming``, ``wrong_vessel``, ``overlap``, ``noise``; of ``symmetric``
        there is the first alone.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    cases : int or None
        Number of cases of each block, the first ones; None for all.
    workers : int
        Number of processes; the results do not depend on it.
    root : str or None
        Folder that keeps the cases; None for the project's cache.

    Raises
    ------
    InputError
        If the subset or a block does not exist, there is more than one method, or a count is out of range.
    """
    one_method(rigid)
    _wanted(subset, blocks, cases)
    require_count("workers", workers)
    if root is not None and Path(root).expanduser().is_file():
        raise InputError(f"root: expected a folder for the cases, received the file {root!r}")


def run(
    *,
    subset: str,
    blocks: Sequence[str],
    rigid: Mapping[str, Any],
    cases: int | None,
    workers: int,
    root: str | None,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Solve the cases of some blocks by one method, from wherever each starts, and score its results.

    Cases that do not exist yet are made. Leaves ``<method>/<case>.json``, one result per case, of other blocks than
    the undeformed one in a folder ``<method>/<block>``, which ``study=evaluate`` scores to the same numbers, and
    ``rigid_benchmark.csv``. A method that raises on a case
    has failed it.

    Parameters
    ----------
    subset : str
        ``development``, ``test`` or ``symmetric``.
    blocks : sequence of str
        Blocks of cases: ``undeformed``, ``deforming``, ``wrong_vessel``, ``overlap``, ``noise``; of ``symmetric``
        there is the first alone.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    cases : int or None
        Number of cases of each block, the first ones; None for all.
    workers : int
        Number of processes; the results do not depend on it.
    root : str or None
        Folder that keeps the cases; None for the project's cache.
    workspace : Path
        Folder of the run in which result files are left.
    progress : Progress
        Receives notes and progress.

    Returns
    -------
    Outcome
        Metrics, a row for each case, tables, figures and findings.

    Raises
    ------
    InputError
        If the settings allow no case.
    """
    check(subset=subset, blocks=blocks, rigid=rigid, cases=cases, workers=workers, root=root)
    name, method = one_method(rigid)
    solved: list[dict[str, Any]] = []
    notes: list[str] = []
    for block, wanted in _wanted(subset, blocks, cases).items():
        collection = collection_name(subset, block)
        folder = _root(root) / collection
        notes += make_cases(folder, wanted, workers, progress, collection)
        out = workspace / name if block == UNDEFORMED else workspace / name / block
        out.mkdir(parents=True)
        names = [spec.name for spec in wanted]
        rows_of = _solved(BenchmarkTrial(name, method, folder, out), names, workers)
        solved += progress.track(rows_of, f"{name}, {collection}", len(names))
    for note in notes:
        progress.note(note)
    rows = _table(solved, subset)
    rows.to_csv(workspace / PER_CASE, index=False)
    return Outcome(
        metrics=benchmark_metrics(rows),
        cases=rows,
        tables=benchmark_tables(rows),
        figures=benchmark_figures(rows),
        findings=(*describe_benchmark(rows), *notes),
        tags={
            "rigid": name,
            "subset": subset,
            "blocks": ", ".join(blocks),
            "simulated": "true",
            "frozen": str(not notes).lower(),
        },
        inputs=tuple(_input(collection_name(subset, block), root) for block in blocks),
    )


def summarise(results: list[JobResult]) -> Outcome:
    """Compare all methods.

    Parameters
    ----------
    results : list of JobResult
        Results of all jobs of the sweep.

    Returns
    -------
    Outcome
        Cases, tables, figures and findings over all jobs.
    """
    import pandas as pd

    kept = [result for result in results if result.cases is not None and len(result.cases)]
    if not kept:
        return Outcome(findings=("No job has cases to summarise.",))
    tables = [result.cases for result in kept if result.cases is not None]
    # A method with other settings is another method.
    methods = distinct_names(kept, [str(rows["method"].iloc[0]) for rows in tables], ("subset",))
    known = [rows.assign(method=method) for rows, method in zip(tables, methods, strict=True)]
    subsets = {str(cases["subset"].iloc[0]) for cases in known}
    if len(subsets) > 1:
        # Cases of two subsets are not one sample.
        known = [cases.assign(method=cases["method"] + ", " + cases["subset"]) for cases in known]
    cases = pd.concat(known, ignore_index=True)
    return Outcome(
        cases=cases,
        tables=benchmark_tables(cases),
        figures=benchmark_figures(cases),
        findings=describe_benchmark(cases),
    )


def _wanted(subset: str, blocks: Sequence[str], cases: int | None) -> dict[str, tuple[CaseSpec, ...]]:
    """The first ``cases`` of each block of a subset, or all."""
    if isinstance(blocks, str) or not blocks or len(set(blocks)) < len(blocks):
        raise InputError(f"blocks: expected a list of at least one block, each once, received {blocks!r}")
    if cases is not None:
        require_count("cases", cases)
    return {block: block_specs(subset, block)[:cases] for block in blocks}


def _root(root: str | None) -> Path:
    return project_root() / DEFAULT_FOLDER if root is None else Path(root).expanduser().absolute()


def _solved(task: BenchmarkTrial, names: list[str], workers: int) -> Iterator[dict[str, Any]]:
    """The rows in the order of the cases, from this process or from several."""
    if workers == 1 or len(names) == 1:
        yield from map(task, names)
        return
    with process_pool(min(workers, len(names))) as pool:
        yield from pool.map(task, names, chunksize=max(len(names) // (8 * workers), 1))


def _table(rows: list[dict[str, Any]], subset: str) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(rows).assign(subset=subset)


def _input(collection: str, root: str | None) -> InputData:
    """A block as it is frozen, known by one digest of all its cases."""
    import hashlib

    digests = frozen_digests().get(collection, {})
    together = hashlib.sha256("".join(digests[name] for name in sorted(digests)).encode()).hexdigest()
    return InputData(f"rigid benchmark, {collection}", together, str(_root(root) / collection))
