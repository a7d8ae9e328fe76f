"""The command line: overrides in, an exit code out. The only module that imports Hydra.

``ctus --help`` answers from the configuration files alone, because even Hydra's import takes a noticeable while.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

from experiments.command_line import words as cli_words
from experiments.command_line.text_settings import loader_with_text, quoted_override
from experiments.errors import InputError, did_you_mean
from experiments.paths import conf_dir, project_root

if TYPE_CHECKING:
    from argparse import Namespace

    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig

    from experiments.running.run_sweep import Points

HYDRA_VERSION_BASE = "1.3"
# Options of Hydra's without a meaning here: a call of ctus is always composed from its own configuration.
NOT_OURS = ("config_path", "config_name", "experimental_rerun", "run")
# Threads of torch that wait by spinning steal the core that the others work on: beside any other process a training
# step takes several times as long. This must be said before torch is imported.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def main(argv: list[str] | None = None) -> int:
    """Run ``ctus`` with these words (those of the process by default) and return its exit code."""
    words = [quoted_override(word) for word in cli_words.read_presets(sys.argv[1:] if argv is None else argv)]
    if "--version" in words:
        return _print_version()
    try:
        if not words or any(word in ("--help", "-h") for word in words):
            return _print_help(words)
        asked = _parsed(words)
        overrides, folder = list(asked.overrides), cli_words.config_folder(asked.config_dir)
        if asked.hydra_help or asked.shell_completion:
            _call_hydra(words)
            return 0
        if asked.cfg or asked.info:
            return _show(asked, overrides, folder)
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    return _run(overrides, folder, multirun=asked.multirun)


def _print_help(words: list[str]) -> int:
    from experiments.command_line.help_page import help_text

    text = help_text(words)
    try:
        print(text, flush=True)
    except (
        BrokenPipeError
    ):  # the reader (head, less) has seen enough; the interpreter's last flush must not fail too
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0 if words else 2


def _print_version() -> int:
    from importlib import metadata

    print(f"ctus {metadata.version('ctus')}")
    return 0


def _parsed(words: list[str]) -> Namespace:
    """The words by Hydra's parser, options before and after the settings; InputError for an unknown option."""
    from hydra._internal.utils import get_args_parser

    parser = get_args_parser()
    names = [
        name for action in parser._actions for name in action.option_strings if action.dest not in NOT_OURS
    ]

    def refuse(message: str) -> NoReturn:
        if not message.startswith("unrecognized arguments: "):
            raise InputError(message)
        word = message.removeprefix("unrecognized arguments: ").split()[0]
        known = ", ".join(name for name in names if name.startswith("--"))
        raise InputError(
            f"{word}: expected one of {known}, received an unknown one{did_you_mean(word, names)}"
        )

    parser.error = refuse
    asked = parser.parse_intermixed_args(words)
    for name in NOT_OURS:
        if getattr(asked, name):
            refuse(f"unrecognized arguments: --{name.replace('_', '-')}")
    return asked


def _show(asked: Namespace, overrides: list[str], folder: str | None) -> int:
    """Print the configuration of every point of a sweep, or what else Hydra tells of one point."""
    from omegaconf import OmegaConf

    composed = _composed(overrides, folder, multirun=asked.multirun)
    if asked.cfg != "job":
        first, *_ = _points(overrides) if asked.multirun else [(overrides, "")]
        kind = ["--cfg", asked.cfg] if asked.cfg else ["--info", asked.info]
        _call_hydra([*kind, *cli_words.words_of_folder(folder), *first[0]])
        return 0
    for config, label in composed:
        job = _without_hydra(config)
        with _as_input_error(overrides):
            if asked.resolve:
                OmegaConf.resolve(job)
            shown = OmegaConf.select(job, asked.package) if asked.package not in (None, "_global_") else job
        heading = f"---\n# {label}\n" if len(composed) > 1 else ""
        print(heading + OmegaConf.to_yaml(shown), end="")
    return 0


def _run(overrides: list[str], folder: str | None, *, multirun: bool) -> int:
    from experiments.command_line.call_checks import require_shared, require_writable
    from experiments.running import jobs, run_sweep
    from experiments.running.run_job import user_errors

    try:
        points = compose_points(overrides, folder, multirun=multirun)
        for config, _ in points:
            require_shared(config)
        cli_words.note_useless_seed(config for config, _ in points)
        require_writable(jobs.out_folder(points[0][0], "0" * 64))
        beside = run_sweep.jobs_at_once(points[0][0]) > 1
        if beside and any(word.startswith("hydra/launcher=") for word in overrides):
            raise InputError("jobs: expected 1 where a launcher starts the jobs, received more")
        launched = multirun and not beside
        words = ["--multirun", *cli_words.words_of_folder(folder), *overrides]
        return run_sweep.run(points, (lambda: _call_hydra(words)) if launched else None)
    except user_errors() as refusal:
        print(refusal, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("Stopped by the keyboard; what had finished is kept.", file=sys.stderr)
        return 130


def compose_points(overrides: list[str], config_dir: str | None = None, *, multirun: bool = False) -> Points:
    """Compose every point of a sweep (one point without ``multirun``): its resolved configuration and a label.

    Raises InputError for an unknown study, group option or setting, for a sweep over no value, and for a value that
    must be given and is not.
    """
    composed = _composed(overrides, config_dir, multirun=multirun)
    with _as_input_error(overrides):
        return [(resolve(config), label) for config, label in composed]


def _composed(
    overrides: list[str], config_dir: str | None, *, multirun: bool
) -> list[tuple[DictConfig, str]]:
    """Every point of a sweep as Hydra composes it, its own node included, and a label."""
    from hydra import compose, initialize_config_dir

    _register_resolvers()
    _keep_names_as_text()
    overrides = [quoted_override(word) for word in cli_words.read_presets(overrides)]
    for word in overrides:
        cli_words.refuse_bare_word(word)
    more = [f"hydra.searchpath=[file://{config_dir}]"] if config_dir else []
    with (
        initialize_config_dir(str(conf_dir()), version_base=HYDRA_VERSION_BASE),
        _as_input_error(overrides, more),
    ):
        parsed = _parsed_overrides(overrides)
        if not multirun and any(override.is_sweep_override() for override in parsed):
            raise InputError(
                "a setting has several values: expected -m (--multirun) before them, received none"
            )
        plain = [str(override.input_line) for override in parsed if not override.is_sweep_override()]
        base = compose("config", plain + more, return_hydra_config=True)
        preset = dict(base.hydra.sweeper.get("params") or {}) if multirun else {}
        return [
            (compose("config", words + more, return_hydra_config=True), label)
            for words, label in _points([f"{key!s}={value}" for key, value in preset.items()] + overrides)
        ]


def _parsed_overrides(overrides: list[str]) -> list[Override]:
    """The overrides by Hydra's grammar; InputError that names the first one that it can't read, or that is empty."""
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    loader = GlobalHydra.instance().config_loader() if GlobalHydra.instance().is_initialized() else None
    parser, parsed = OverridesParser.create(config_loader=loader), []
    for word in overrides:
        name, _, value = word.partition("=")
        try:
            (override,) = parser.parse_overrides([word])
            if override.is_discrete_sweep() and next(override.sweep_string_iterator(), None) is None:
                raise InputError(
                    f"{name}: expected at least one value to sweep over, received none in {value}"
                )
        except (HydraException, ValueError) as refusal:
            if isinstance(refusal, InputError):
                raise
            raise InputError(
                f"{word}: expected setting=value (a value with any of = , : {{ }} or a blank needs quotes: "
                f"'{name}=\"{value}\"'), received what can't be read: {str(refusal).splitlines()[0]}"
            ) from refusal
        if not override.is_delete() and not override.is_sweep_override():
            cli_words.refuse_no_option(override.key_or_group, override.value())
        parsed.append(override)
    return parsed


@contextmanager
def _as_input_error(overrides: list[str], more: list[str] | None = None) -> Iterator[None]:
    """Turn what Hydra and OmegaConf refuse into an InputError of one sentence."""
    from hydra import compose
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        yield
    except (HydraException, OmegaConfBaseException) as refusal:
        # The settings there are, as the choices among the words bring them, are what a misspelt one is compared with.
        groups = cli_words.group_names()
        chosen = [
            word for word in overrides if word.lstrip("+").partition("=")[0].partition("@")[0] in groups
        ]
        study = next((word.partition("=")[2] for word in overrides if word.startswith("study=")), None)
        known: list[str] = []
        for words in (chosen, [word for word in chosen if word.startswith("study=")]):
            try:
                plain = OmegaConf.to_container(compose("config", words + (more or [])), resolve=False)
            except Exception:  # the choices themselves may be what is wrong
                continue
            known = [*cli_words.setting_names(plain), "study"]  # type: ignore[arg-type]
            break
        raise InputError(cli_words.sentence(refusal, study, known)) from refusal


def _register_resolvers() -> None:
    """Make ``${project:folder}`` a folder of the project, and ``${method:name.setting}`` that of a rigid method."""
    from omegaconf import OmegaConf

    from experiments.command_line.method_settings import method_setting

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
    from omegaconf import OmegaConf

    study = config.hydra.runtime.choices.get("study")
    if study is None:
        from experiments.running.jobs import study_names

        raise InputError(
            f"study: expected one of {', '.join(study_names())}, received none; pass study=<name>"
        )
    config = _without_hydra(config)
    missing = sorted(OmegaConf.missing_keys(config))
    if missing:
        raise InputError(
            f"study={study}: expected a value for {', '.join(missing)}; pass {missing[0]}=<value>"
        )
    plain = OmegaConf.to_container(config, resolve=True)
    assert isinstance(plain, dict)
    return {"study": study, **{str(key): value for key, value in plain.items()}}


def _without_hydra(config: DictConfig) -> DictConfig:
    from omegaconf import OmegaConf, open_dict

    with open_dict(config):
        return OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])


def _points(overrides: list[str]) -> list[tuple[list[str], str]]:
    """The overrides of every point of a sweep, and a label made of those that vary."""
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper

    parsed = _parsed_overrides(overrides)
    varying = {override.get_key_element() for override in parsed if override.is_sweep_override()}
    (batch,) = BasicSweeper.split_arguments(parsed, None)
    return [(words, ",".join(word for word in words if word.split("=")[0] in varying)) for words in batch]


def _call_hydra(words: list[str]) -> None:
    """Hand the words to Hydra's own entry point, which reads them from ``sys.argv``, options first."""
    import hydra

    _keep_names_as_text()
    before = sys.argv
    sys.argv = [before[0] if before else "ctus", *words]
    try:
        hydra.main(version_base=HYDRA_VERSION_BASE, config_path=str(conf_dir()), config_name="config")(
            _point
        )()
    finally:
        sys.argv = before


def _point(config: DictConfig) -> None:
    """One job of Hydra's: a point of the sweep."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import open_dict

    from experiments.running import run_sweep

    _register_resolvers()  # a launcher may have started this process
    with open_dict(config):
        config["hydra"] = {"runtime": {"choices": HydraConfig.get().runtime.choices}}
    run_sweep.run_point(resolve(config))


if __name__ == "__main__":
    sys.exit(main())
