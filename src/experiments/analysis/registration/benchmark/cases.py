"""The cases of the frozen rigid benchmark on disk: made where they are missing, and compared with what they were."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from concurrent.futures import as_completed
from pathlib import Path

from filelock import FileLock

from experiments import files
from experiments.errors import InputError
from experiments.outcome import Progress
from experiments.paths import conf_dir
from experiments.process_pool import process_pool, same_kernels
from registration import errors as registration_errors
from registration.benchmark.build import CaseSpec, build_case, specs
from registration.benchmark.case_files import write_case, written_digest

DEFAULT_FOLDER = Path(".cache") / "rigid_benchmark"


def frozen_file() -> Path:
    """Give the file that holds the digests of all cases, by subset and case.

    Returns
    -------
    Path
        Path of the committed JSON file; it need not exist.
    """
    return conf_dir() / "benchmark" / "rigid.json"


def subset_specs(subset: str) -> tuple[CaseSpec, ...]:
    """List the cases of a subset.

    Parameters
    ----------
    subset : str
        Name of the subset.

    Returns
    -------
    tuple of CaseSpec
        The cases, in a fixed order.

    Raises
    ------
    InputError
        If the subset is unknown; the message names those there are.
    """
    try:
        return specs(subset)
    except registration_errors.InputError as refusal:
        raise InputError(str(refusal)) from refusal


def make_cases(
    folder: Path, wanted: Sequence[CaseSpec], workers: int, progress: Progress, subset: str
) -> tuple[str, ...]:
    """Make the cases that a folder does not hold yet, and say which are not the frozen ones.

    Cases are independent of each other and of the number of processes. A complete case is left as it is, so
    that a stopped run is resumed. Several runs may ask for the same cases: one makes them, the others wait.

    Parameters
    ----------
    folder : Path
        Folder of the subset's cases; made if it is missing.
    wanted : sequence of CaseSpec
        Cases that must be there afterwards.
    workers : int
        Number of processes at most.
    progress : Progress
        Shows how many cases are made.
    subset : str
        Name of the subset, for messages and to find the frozen digests.

    Returns
    -------
    tuple of str
        One sentence if cases differ from the frozen ones, else none.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / ".lock"):
        missing = [spec for spec in wanted if written_digest(folder, spec.name) is None]
        if missing:
            made = _made(folder, missing, workers)
            for _ in progress.track(made, f"Making {len(missing)} {subset} cases", len(missing)):
                pass
    return differences(folder, [spec.name for spec in wanted], subset)


def differences(folder: Path, names: Sequence[str], subset: str) -> tuple[str, ...]:
    """Say how many cases are not the frozen ones.

    Parameters
    ----------
    folder : Path
        Folder of the subset's cases.
    names : sequence of str
        Names of the cases to compare.
    subset : str
        Name of the subset.

    Returns
    -------
    tuple of str
        One sentence with the number and the first of them; none if all are as frozen.
    """
    frozen = frozen_digests().get(subset, {})
    changed = [name for name in names if frozen.get(name) != written_digest(folder, name)]
    if not changed:
        return ()
    return (
        f"{len(changed)} of {len(names)} {subset} cases in {folder} are not the frozen ones (first: {changed[0]}): "
        "made by other versions of the code or its libraries, or on a platform that rounds differently. Numbers "
        "measured on them are not comparable; delete the folder to make them again.",
    )


def frozen_digests() -> dict[str, dict[str, str]]:
    """Read the committed digest of every case.

    Returns
    -------
    dict
        Digests by subset and name of the case; empty if there is no such file.
    """
    path = frozen_file()
    if not path.is_file():
        return {}
    found: dict[str, dict[str, str]] = json.loads(path.read_text(encoding="utf-8"))
    return found


def freeze(folders: dict[str, Path]) -> int:
    """Write the digests of the cases as they are on disk to the file of frozen digests.

    Parameters
    ----------
    folders : dict
        Folder of the cases of each subset to freeze; other subsets keep their digests.

    Returns
    -------
    int
        Number of digests in the file.

    Raises
    ------
    InputError
        If a folder lacks a case of its subset, or a subset is unknown.
    """
    found = frozen_digests()
    for subset, folder in folders.items():
        found[subset] = {spec.name: written_digest(folder, spec.name) or "" for spec in subset_specs(subset)}
        lacking = [name for name, digest in found[subset].items() if not digest]
        if lacking:
            raise InputError(f"{folder}: expected all cases of {subset}, received none of {lacking[0]}")
    files.write_text(frozen_file(), json.dumps(found, indent=0) + "\n")
    return sum(len(digests) for digests in found.values())


def _made(folder: Path, missing: Sequence[CaseSpec], workers: int) -> Iterable[str]:
    """The names of the cases as they are made; those of one anatomy by one process, which keeps its surface."""
    groups = [
        [spec for spec in missing if spec.anatomy == anatomy]
        for anatomy in dict.fromkeys(spec.anatomy for spec in missing)
    ]
    # In processes of their own also where one works: this one has loaded the kernels of its processor already.
    with same_kernels(), process_pool(min(workers, len(groups))) as pool:
        for ready in as_completed([pool.submit(_make, folder, group) for group in groups]):
            yield from ready.result()


def _make(folder: Path, group: Sequence[CaseSpec]) -> list[str]:
    for spec in group:
        write_case(folder, *build_case(spec))
    return [spec.name for spec in group]
