"""The help page, read from the configuration files without Hydra, so that it answers at once."""

from __future__ import annotations

from pathlib import Path

from experiments.errors import InputError
from experiments.paths import conf_dir

# The folder of the presets: see experiments.cli on why it is not called sweep.
PRESETS = "preset"

_USAGE = """\
ctus: CT-ultrasound registration of vessels, as tracked experiments

  ctus study=<name> [setting=value ...]            one call, all jobs of the study
  ctus -m study=<name> model=a,b seed=0,1,2 ...    a sweep over every combination
  ctus -m +sweep=<preset> [setting=value ...]      all that a published figure needs
  ctus study=<name> --help                         the settings of a study
"""

_AFTER = """\
Settings of every study
  out=<folder>             where the results go
  resume=true              skip the jobs that have a finished run
  seed=<number>            of every random choice
  tracking.uri=<address>   an MLflow server; tracking.enabled=false tracks nothing
  --cfg job                print the composed configuration and stop
  --shell-completion install=bash|zsh|fish   completion for the shell (see the README)
"""


def help_text(studies: list[str]) -> str:
    """The page for one study if one is named, else the overview."""
    return _study_page(studies[0]) if studies else _overview()


def description(path: Path) -> str:
    """What a configuration file says of itself: its first comment that is not a Hydra directive."""
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("#") and "@package" not in line:
            return line.lstrip("# ").strip()
        if line.strip() and not line.startswith("#"):
            break
    return ""


def _overview() -> str:
    names = sorted((conf_dir() / "study").glob("*.yaml"))
    width = max((len(path.stem) for path in names), default=0)
    studies = "\n".join(f"  {path.stem:<{width}}  {description(path)}" for path in names)
    groups = "\n".join(
        f"  {folder.name}={'|'.join(path.stem for path in sorted(folder.glob('*.yaml')))}"
        for folder in sorted(conf_dir().iterdir())
        if folder.is_dir() and folder.name not in ("study", PRESETS) and any(folder.glob("*.yaml"))
    )
    presets = "\n".join(
        f"  +sweep={path.stem}  {description(path)}" for path in sorted((conf_dir() / PRESETS).glob("*.yaml"))
    )
    return f"{_USAGE}\nStudies\n{studies}\n\nPresets\n{presets}\n\nChoices\n{groups}\n\n{_AFTER}"


def _study_page(name: str) -> str:
    path = conf_dir() / "study" / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(other.stem for other in path.parent.glob("*.yaml")))
        raise InputError(f"study: expected one of {known}, received {name!r}")
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if "@package" not in line]
    return f"ctus study={name} [setting=value ...]\n\n" + "\n".join(lines) + f"\n\n{_AFTER}"
