"""The frozen benchmark of rigid registration: simulated sweeps of random anatomies, solved and scored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.analysis.registration.benchmark.cases import (
    DEFAULT_FOLDER,
    frozen_digests,
    make_cases,
    subset_specs,
)
from experiments.analysis.registration.benchmark.figures import benchmark_figures
from experiments.analysis.registration.benchmark.findings import describe_benchmark
from experiments.analysis.registration.benchmark.tables import benchmark_metrics, benchmark_tables
from experiments.analysis.variants import distinct_names
from experiments.errors import InputError, require_count
from experiments.inputs.surfaces import one_method
from experiments.outcome import InputData, JobResult, Outcome, Progress
from experiments.paths import project_root
from experiments.process_pool import process_pool
from experiments.studies.rigid_benchmark.trial import BenchmarkTrial

if TYPE_CHECKING:
    import pandas as pd

    from registration.benchmark.build import CaseSpec

PER_CASE = "rigid_benchmark.csv"


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
    *, subset: str, rigid: Mapping[str, Any], cases: int | None, workers: int, root: str | None
) -> None:
    """Check that the subset exists and that the settings allow cases.

    Parameters
    ----------
    subset : str
        ``development``, ``test`` or ``symmetric``.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    cases : int or None
        Number of cases, the first ones; None for all.
    workers : int
        Number of processes; the results do not depend on it.
    root : str or None
        Folder that keeps the cases; None for the project's cache.

    Raises
    ------
    InputError
        If the subset does not exist, there is more than one method, or a count is out of range.
    """
    one_method(rigid)
    _wanted(subset, cases)
    require_count("workers", workers)
    if root is not None and Path(root).expanduser().is_file():
        raise InputError(f"root: expected a folder for the cases, received the file {root!r}")


def run(
    *,
    subset: str,
    rigid: Mapping[str, Any],
    cases: int | None,
    workers: int,
    root: str | None,
    workspace: Path,
    progress: Progress,
) -> Outcome:
    """Solve the cases of a subset by one method, from wherever each starts, and score its results.

    Cases that do not exist yet are made. Leaves ``<method>/<case>.json``, one result per case, which
    ``study=evaluate`` scores to the same numbers, and ``rigid_benchmark.csv``. A method that raises on a case
    has failed it.

    Parameters
    ----------
    subset : str
        ``development``, ``test`` or ``symmetric``.
    rigid : Mapping[str, Any]
        Settings of exactly one rigid registration method by its name.
    cases : int or None
        Number of cases, the first ones; None for all.
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
    check(subset=subset, rigid=rigid, cases=cases, workers=workers, root=root)
    name, method = one_method(rigid)
    wanted = _wanted(subset, cases)
    folder = _root(root) / subset
    notes = make_cases(folder, wanted, workers, progress, subset)
    for note in notes:
        progress.note(note)
    (workspace / name).mkdir()
    task = BenchmarkTrial(name, method, folder, workspace / name)
    names = [spec.name for spec in wanted]
    solved = progress.track(_solved(task, names, workers), f"{name}, {subset}", len(names))
    rows = _table(list(solved), subset)
    rows.to_csv(workspace / PER_CASE, index=False)
    return Outcome(
        metrics=benchmark_metrics(rows),
        cases=rows,
        tables=benchmark_tables(rows),
        figures=benchmark_figures(rows),
        findings=(*describe_benchmark(rows), *notes),
        tags={"rigid": name, "subset": subset, "simulated": "true", "frozen": str(not notes).lower()},
        inputs=(InputData(f"rigid benchmark, {subset}", _digest(subset), str(folder)),),
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


def _wanted(subset: str, cases: int | None) -> tuple[CaseSpec, ...]:
    """The first ``cases`` of a subset, or all."""
    wanted = subset_specs(subset)
    if cases is None:
        return wanted
    require_count("cases", cases)
    return wanted[:cases]


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


def _digest(subset: str) -> str:
    """One digest of all frozen cases of a subset."""
    import hashlib

    digests = frozen_digests().get(subset, {})
    return hashlib.sha256("".join(digests[name] for name in sorted(digests)).encode()).hexdigest()
