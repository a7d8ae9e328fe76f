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
from registration.benchmark.blocks import CaseSpec, collection_name, specs
from registration.benchmark.build import build_case
from registration.benchmark.case_files import write_case, written_digest
from registration.benchmark.cases import UNDEFORMED

DEFAULT_FOLDER = Path(".cache") / "rigid_benchmark"


def frozen_file() -> Path:
    """Give the file that holds the digests of all cases, by collection (a block of a subset) and case.

    Returns
    -------
    Path
        Path of the committed JSON file; it need not exist.
    """
    return conf_dir() / "benchmark" / "rigid.json"


def block_specs(subset: str, block: str = UNDEFORMED) -> tuple[CaseSpec, ...]:
    """List the cases of a block.

    Parameters
    ----------
    subset : str
        Name of the subset.
    block : str, optional
        Name of the block.

    Returns
    -------
    tuple of CaseSpec
        The cases, in a fixed order.

    Raises
    ------
    InputError
        If the subset or the block is unknown; the message names those there are.
    """
    try:
        return specs(subset, block)
    except registration_errors.InputError as refusal:
        raise InputError(str(refusal)) from refusal


def make_cases(
    folder: Path, wanted: Sequence[CaseSpec], workers: int, progress: Progress, collection: str
) -> tuple[str, ...]:
    """Make the cases that a folder does not hold yet, and say which are not the frozen ones.

    Cases are independent of each other and of the number of processes. A complete case is left as it is, so
    that a stopped run is resumed. Several runs may ask for the same cases: one makes them, the others wait.

    Parameters
    ----------
    folder : Path
        Folder of the block's cases; made if it is missing.
    wanted : sequence of CaseSpec
        Cases that must be there afterwards.
    workers : int
        Number of processes at most.
    progress : Progress
        Shows how many cases are made.
    collection : str
        Name of the collection, for messages and to find the frozen digests.

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
            for _ in progress.track(made, f"Making {len(missing)} {collection} cases", len(missing)):
                pass
    return differences(folder, [spec.name for spec in wanted], collection)


def differences(folder: Path, names: Sequence[str], collection: str) -> tuple[str, ...]:
    """Say how many cases are not the frozen ones.

    Parameters
    ----------
    folder : Path
        Folder of the cases.
    names : sequence of str
        Names of the cases to compare.
    collection : str
        Name of the collection.

    Returns
    -------
    tuple of str
        One sentence with the number and the first of them; none if all are as frozen.
    """
    frozen = frozen_digests().get(collection, {})
    changed = [name for name in names if frozen.get(name) != written_digest(folder, name)]
    if not changed:
        return ()
    return (
        f"{len(changed)} of {len(names)} {collection} cases in {folder} are not the frozen ones (first: {changed[0]}): "
        "made by other versions of the code or its libraries, or on a platform that rounds differently. Numbers "
        "measured on them are not comparable; delete the folder to make them again.",
    )


def frozen_digests() -> dict[str, dict[str, str]]:
    """Read the committed digest of every case.

    Returns
    -------
    dict
        Digests by collection and name of the case; empty if there is no such file.
    """
    path = frozen_file()
    if not path.is_file():
        return {}
    found: dict[str, dict[str, str]] = json.loads(path.read_text(encoding="utf-8"))
    return found


def freeze(folders: dict[tuple[str, str], Path]) -> int:
    """Write the digests of the cases as they are on disk to the file of frozen digests.

    Parameters
    ----------
    folders : dict
        Folder of the cases of each subset and block to freeze; others keep their digests.

    Returns
    -------
    int
        Number of digests in the file.

    Raises
    ------
    InputError
        If a folder lacks a case of its block, or a subset or block is unknown.
    """
    found = frozen_digests()
    for (subset, block), folder in folders.items():
        name = collection_name(subset, block)
        found[name] = {
            spec.name: written_digest(folder, spec.name) or "" for spec in block_specs(subset, block)
        }
        lacking = [case for case, digest in found[name].items() if not digest]
        if lacking:
            raise InputError(f"{folder}: expected all cases of {name}, received none of {lacking[0]}")
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
