"""The interpreter, the packages that ctus needs or can use, and the system libraries that these load."""

from __future__ import annotations

import ctypes
import importlib.util
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata

from packaging.requirements import Requirement

from experiments.command_line.doctor.findings import Finding, State

# What Open3D and VTK load at run time: the library and the package of Debian and of Fedora that has it.
# scripts/setup.sh installs the same.
LIBRARIES = {
    "libusb-1.0.so.0": ("libusb-1.0-0", "libusb1"),
    "libgomp.so.1": ("libgomp1", "libgomp"),
    "libGL.so.1": ("libgl1", "mesa-libGL"),
    "libEGL.so.1": ("libegl1", "mesa-libEGL"),
    "libX11.so.6": ("libx11-6", "libX11"),
}
OLDEST, NEWEST_TESTED = (3, 11), (3, 13)
# Packages whose versions a report of a fault is read by.
_NAMED = ("torch", "lightning", "monai", "mlflow", "hydra-core", "open3d", "vtk", "numpy", "scipy", "pandas")
_OPTIONAL = {
    "onnx": "study=export_model and engine=onnxruntime",
    "openvino": "engine=openvino",
    "video": "videos as input of study=segment",
    "kiss": "rigid=kiss_matcher",
    "natural-images": "init=natural_images",
}


def interpreter(version: tuple[int, int] = sys.version_info[:2]) -> Finding:
    """Look at the version of Python.

    Parameters
    ----------
    version : tuple[int, int], optional
        Major and minor version; that of this process by default.

    Returns
    -------
    Finding
        Missing below the oldest version; a note above the newest that is tested.
    """
    shown = f"Python {version[0]}.{version[1]} on {platform.system()} {platform.machine()}, {sys.executable}"
    if version < OLDEST:
        return Finding(
            "Python", State.MISSING, f"{shown}; expected 3.11 to 3.13", "make setup PYTHON=python3.12"
        )
    if version > NEWEST_TESTED:
        return Finding("Python", State.NOTE, f"{shown}; made for 3.11 to 3.13")
    return Finding("Python", State.OK, shown)


def required_packages(distribution: str = "ctus") -> list[Finding]:
    """Compare the installed packages with those that a distribution asks for, without importing any.

    Parameters
    ----------
    distribution : str, optional
        Name of the distribution.

    Returns
    -------
    list of Finding
        One finding if all is there, else one for the distribution or for the packages that are missing or do not fit.
    """
    try:
        needed = [Requirement(text) for text in metadata.requires(distribution) or []]
        version = metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return [
            Finding(
                distribution, State.MISSING, "is not installed in this environment", _pip(["--editable", "."])
            )
        ]
    needed = [each for each in needed if _applies(each, "")]
    wrong = {str(each): found for each in needed if (found := _fault(each)) is not None}
    findings = [Finding(distribution, State.OK, f"version {version}")]
    if wrong:
        text = "; ".join(f"{name} ({found})" for name, found in wrong.items())
        findings.append(Finding("packages", State.MISSING, text, _pip(list(wrong))))
    else:
        named = ", ".join(f"{name} {metadata.version(name)}" for name in _NAMED if _version(name))
        findings.append(Finding("packages", State.OK, f"all {len(needed)} that ctus needs: {named}, ..."))
    return findings


def optional_packages(extras: Mapping[str, str] = _OPTIONAL, distribution: str = "ctus") -> list[Finding]:
    """Look for what a distribution can use but does not need.

    Parameters
    ----------
    extras : mapping of str to str, optional
        Name of each extra and what it is for.
    distribution : str, optional
        Name of the distribution.

    Returns
    -------
    list of Finding
        One for the extras that are complete, and a note with its line for each that is not; empty if the distribution
        is not installed.
    """
    try:
        texts = metadata.requires(distribution) or []
    except metadata.PackageNotFoundError:
        return []
    findings, complete = [], []
    for extra, purpose in extras.items():
        wanted = [
            each for each in map(Requirement, texts) if not _applies(each, "") and _applies(each, extra)
        ]
        lacking = [str(_without_marker(each)) for each in wanted if _fault(each) is not None]
        if lacking:
            findings.append(
                Finding(f"extra {extra}", State.NOTE, f"not installed; for {purpose}", _pip(lacking))
            )
        elif wanted:
            complete.append(extra)
    ready = [Finding("extras", State.OK, ", ".join(complete))] if complete else []
    return [*ready, *findings]


def system_libraries(libraries: Mapping[str, tuple[str, str]] = LIBRARIES) -> list[Finding]:
    """Load the libraries of the system that Open3D and VTK load.

    Parameters
    ----------
    libraries : mapping of str to tuple[str, str], optional
        File name of each library and the packages of Debian and of Fedora that have it.

    Returns
    -------
    list of Finding
        One finding; empty where the wheels bring what they need (macOS, Windows).
    """
    if platform.system() != "Linux":
        return []
    missing = [name for name in libraries if not _loads(name)]
    if not missing:
        return [Finding("system libraries", State.OK, ", ".join(libraries))]
    which, before = (1, "sudo dnf install -y") if shutil.which("dnf") else (0, "sudo apt-get install -y")
    packages = " ".join(libraries[name][which] for name in missing)
    return [Finding("system libraries", State.MISSING, ", ".join(missing), f"{before} {packages}")]


def compiled_packages(names: Sequence[str] = ("open3d", "vtkmodules.vtkCommonCore")) -> list[Finding]:
    """Import packages that need libraries of the system, in a process of its own.

    Parameters
    ----------
    names : sequence of str, optional
        Names of modules.

    Returns
    -------
    list of Finding
        One for each that is installed and does not load, with what the system says of it.
    """
    findings = []
    for name in names:
        if importlib.util.find_spec(name.partition(".")[0]) is None:
            continue
        tried = subprocess.run([sys.executable, "-c", f"import {name}"], capture_output=True, text=True)
        if tried.returncode:
            said = (tried.stderr.strip().splitlines() or [f"exit code {tried.returncode}"])[-1]
            text = f"{name.partition('.')[0]} does not load: {said}"
            findings.append(Finding("packages", State.MISSING, text))
    return findings


def _loads(name: str) -> bool:
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def _applies(requirement: Requirement, extra: str) -> bool:
    return requirement.marker is None or requirement.marker.evaluate({"extra": extra})


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _fault(requirement: Requirement) -> str | None:
    """What is wrong with the installed version; None if it fits."""
    version = _version(requirement.name)
    if version is None:
        return "not installed"
    fits = requirement.specifier.contains(version, prereleases=True)
    return None if fits else f"{version} is installed"


def _without_marker(requirement: Requirement) -> Requirement:
    plain = Requirement(str(requirement))
    plain.marker = None
    return plain


def _pip(words: Sequence[str]) -> str:
    return shlex.join([sys.executable, "-m", "pip", "install", *_unmarked(words)])


def _unmarked(words: Sequence[str]) -> Iterator[str]:
    """The words without markers, which a shell's user has no need of."""
    for word in words:
        yield word.partition(";")[0].strip()
