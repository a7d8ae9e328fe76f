"""The command line: overrides in, an exit code out. The only module that imports Hydra.

``ctus --help`` answers from the configuration files alone, because even Hydra's import takes a noticeable while.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from experiments.errors import InputError
from experiments.paths import conf_dir, project_root
from experiments.text_settings import loader_with_text, quoted_override

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from experiments.shell import Points

HYDRA_VERSION_BASE = "1.3"
# Threads of torch that wait by spinning steal the core that the others work on: beside any other process a training
# step takes several times as long. This must be said before torch is imported.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def main(argv: list[str] | None = None) -> int:
    """Run ``ctus`` with these words (those of the process by default) and return its exit code."""
    words = [quoted_override(word) for word in _with_presets(sys.argv[1:] if argv is None else argv)]
    if not words or any(word in ("--help", "-h") for word in words):
        return _print_help(words)
    from hydra._internal.utils import get_args_parser

    try:
        asked = get_args_parser().parse_args(words)
    except SystemExit as ended:  # the parser has said what is wrong
        return int(ended.code or 0)
    if any((asked.cfg, asked.info, asked.hydra_help, asked.shell_completion)):
        _call_hydra(words, _point)
        return 0
    return _run(words, list(asked.overrides), asked.config_dir, multirun=asked.multirun)


def _print_help(words: list[str]) -> int:
    from experiments.cli_help import help_text

    try:
        print(help_text([word.removeprefix("study=") for word in words if word.startswith("study=")]))
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    return 0 if words else 2


def _run(words: list[str], overrides: list[str], config_dir: str | None, *, multirun: bool) -> int:
    from experiments import shell
    from experiments.job import user_errors

    try:
        points = compose_points(overrides, config_dir, multirun=multirun)
        beside = shell.jobs_at_once(points[0][0]) > 1
        if beside and any(word.startswith("hydra/launcher=") for word in overrides):
            raise InputError("jobs: expected 1 where a launcher starts the jobs, received more")
        launched = multirun and not beside
        return shell.run(points, (lambda: _call_hydra(words, _point)) if launched else None)
    except user_errors() as refusal:
        print(refusal, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("Stopped by the keyboard; what had finished is kept.", file=sys.stderr)
        return 130


def compose_points(overrides: list[str], config_dir: str | None = None, *, multirun: bool = False) -> Points:
    """Compose every point of a sweep (one point without ``multirun``): its resolved configuration and a label.

    Raises InputError for an unknown study, group option or setting, and for a value that must be given and is not.
    """
    from hydra import compose, initialize_config_dir
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    _register_resolvers()
    _keep_names_as_text()

    overrides = [quoted_override(word) for word in _with_presets(overrides)]
    _refuse_unreadable(overrides)
    more = [f"hydra.searchpath=[file://{config_dir}]"] if config_dir else []
    try:
        with initialize_config_dir(str(conf_dir()), version_base=HYDRA_VERSION_BASE):
            fixed = OverridesParser.create().parse_overrides(overrides)
            if not multirun and any(override.is_sweep_override() for override in fixed):
                raise InputError(
                    "a setting has several values: expected -m (--multirun) before them, received none"
                )
            plain = [str(override.input_line) for override in fixed if not override.is_sweep_override()]
            base = compose("config", plain + more, return_hydra_config=True)
            preset = dict(base.hydra.sweeper.get("params") or {}) if multirun else {}
            points = []
            for words, label in _points([f"{key!s}={value}" for key, value in preset.items()] + overrides):
                config = compose("config", words + more, return_hydra_config=True)
                points.append((resolve(config), label))
    except (HydraException, OmegaConfBaseException) as refusal:
        raise InputError(_sentence(refusal)) from refusal
    return points


def _with_presets(words: list[str]) -> list[str]:
    """Read ``+sweep=<name>`` as the group of presets.

    A group can't be called ``sweep`` itself: Hydra would take the setting ``sweep=<recording>`` of the studies that
    read one for an option of that group.
    """
    return [
        f"+preset={word.removeprefix('+sweep=')}" if word.startswith("+sweep=") else word for word in words
    ]


def _refuse_unreadable(overrides: list[str]) -> None:
    """Raise InputError that names the first word that Hydra's grammar can't read."""
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    for word in overrides:
        try:
            OverridesParser.create().parse_override(word)
        except HydraException as refusal:
            name, _, value = word.partition("=")
            raise InputError(
                f"{word}: expected setting=value (a value with any of = , : {{ }} or a blank needs quotes: "
                f"'{name}=\"{value}\"'), received what can't be read: {str(refusal).splitlines()[0]}"
            ) from refusal


def _register_resolvers() -> None:
    """Make ``${project:folder}`` a folder of the project, and ``${method:name.setting}`` that of a rigid method."""
    from omegaconf import OmegaConf

    from experiments.method_settings import method_setting

    OmegaConf.register_new_resolver("project", lambda part: str(project_root() / part), replace=True)
    OmegaConf.register_new_resolver("method", method_setting, replace=True)


def _keep_names_as_text() -> None:
    """Have configuration files read so that names and paths in them are text, whatever they look like."""
    from omegaconf import _utils

    plain = _utils.get_yaml_loader
    if not hasattr(plain, "keeps_names"):

        def keeping() -> Any:
            return loader_with_text(plain())

        keeping.keeps_names = True  # type: ignore[attr-defined]
        _utils.get_yaml_loader = keeping


def resolve(config: DictConfig) -> Mapping[str, Any]:
    """The resolved configuration as plain data, with the study's name under ``study``."""
    from omegaconf import OmegaConf, open_dict

    study = config.hydra.runtime.choices.get("study")
    if study is None:
        from experiments.cells import study_names

        raise InputError(
            f"study: expected one of {', '.join(study_names())}, received none; pass study=<name>"
        )
    with open_dict(config):
        config = OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])
    missing = sorted(OmegaConf.missing_keys(config))
    if missing:
        raise InputError(
            f"study={study}: expected a value for {', '.join(missing)}; pass {missing[0]}=<value>"
        )
    plain = OmegaConf.to_container(config, resolve=True)
    assert isinstance(plain, dict)
    return {"study": study, **{str(key): value for key, value in plain.items()}}


def _points(overrides: list[str]) -> list[tuple[list[str], str]]:
    """The overrides of every point of a sweep, and a label made of those that vary."""
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
    from hydra.core.override_parser.overrides_parser import OverridesParser

    parsed = OverridesParser.create().parse_overrides(overrides)
    varying = {override.get_key_element() for override in parsed if override.is_sweep_override()}
    (batch,) = BasicSweeper.split_arguments(parsed, None)
    return [(words, ",".join(word for word in words if word.split("=")[0] in varying)) for words in batch]


def _call_hydra(words: list[str], task: Any) -> None:
    """Hand the words to Hydra's own entry point, which reads them from ``sys.argv``."""
    import hydra

    _keep_names_as_text()
    before = sys.argv
    sys.argv = [before[0] if before else "ctus", *words]
    try:
        hydra.main(version_base=HYDRA_VERSION_BASE, config_path=str(conf_dir()), config_name="config")(task)()
    finally:
        sys.argv = before


def _point(config: DictConfig) -> None:
    """One job of Hydra's: a point of the sweep."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import open_dict

    from experiments import shell

    _register_resolvers()  # a launcher may have started this process
    with open_dict(config):
        config["hydra"] = {"runtime": {"choices": HydraConfig.get().runtime.choices}}
    shell.run_point(resolve(config))


def _sentence(refusal: Exception) -> str:
    """Hydra's message as one sentence that says what was expected and found."""
    options, wrong = getattr(refusal, "options", None), getattr(refusal, "missing_cfg_file", None)
    if wrong and options:
        group, _, option = str(wrong).rpartition("/")
        return f"{group}: expected one of {', '.join(sorted(options))}, received {option!r}"
    lines = [line.strip() for line in str(refusal).splitlines() if line.strip()]
    cause = refusal.__cause__
    if cause is not None and "is not in struct" in str(cause):
        return (
            f"{lines[0].rstrip('.')}: expected a setting of the study (ctus study=<name> --help lists them)"
        )
    return "; ".join(lines)


if __name__ == "__main__":
    sys.exit(main())
