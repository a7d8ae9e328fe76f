"""The command line: overrides in, an exit code out. The only module that imports Hydra.

``ctus --help`` answers from the configuration files alone, because even Hydra's import takes a noticeable while.
"""

from __future__ import annotations

import copy
import gc
import itertools
import os
import shlex
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.command_line import words as cli_words
from experiments.command_line.call_options import CallOptions, read_options
from experiments.command_line.completion import own_completion
from experiments.command_line.foreign_folder import require_harmless_folder
from experiments.command_line.text_settings import fast_loader, loader_with_text, quoted_override
from experiments.errors import InputError, user_errors
from experiments.paths import conf_dir, project_root
from experiments.plugins import plugin_config_folders
from experiments.running.verbosity import read_verbosity, saying

if TYPE_CHECKING:
    from hydra._internal.config_loader_impl import ConfigLoaderImpl
    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig

    from experiments.running.run_sweep import SweepPoints

HYDRA_VERSION_BASE = "1.3"
# Exit codes as a shell gives them for SIGINT and SIGPIPE.
STOPPED, BROKEN_PIPE = 130, 141
# What a preset may set of Hydra's own: the values of a sweep. How its jobs are started is set by jobs=<number>.
NOT_CHOSEN = ("hydra/launcher", "hydra/sweeper")
# Threads of torch that wait by spinning steal the core that the others work on: with any other process running,
# a training step takes several times as long. This must be set before torch is imported.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def main(argv: list[str] | None = None) -> int:
    """Run ``ctus`` with these words (those of the process by default) and return its exit code.

    Parameters
    ----------
    argv : list[str] or None, optional
        Words of the command line; None for those of the process.

    Returns
    -------
    int
        Exit code: 0 all is well, 1 a job failed, 2 the input is at fault, 130 stopped by the keyboard, 141 nobody reads
        what is printed any more.
    """
    if argv is None:
        # Loading the libraries makes objects that stay: looking through all of them every 700 new ones, as Python does
        # by itself, takes a seventh of a short call's processor time.
        gc.set_threshold(20_000, 20, 20)
    try:
        given, level = read_verbosity(sys.argv[1:] if argv is None else argv)
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        return 2
    try:
        with saying(level):
            code = _main([quoted_override(word) for word in cli_words.read_presets(given)])
            sys.stdout.flush()
            return code
    except BrokenPipeError:
        # The reader (head, less) has seen enough; the interpreter's last flush must not fail too.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except KeyboardInterrupt:
        print("Stopped by the keyboard.", file=sys.stderr)
        return STOPPED


def _main(words: list[str]) -> int:
    if "--version" in words:
        return _print_version()
    try:
        if words[:1] == ["doctor"]:
            from experiments.command_line.doctor.report import doctor

            return doctor(words[1:])
        if words[:1] == ["demo"]:
            from experiments.command_line.demonstration import demo

            return demo(words[1:])
        if not words or any(word in ("--help", "-h") for word in words):
            return _print_help(words)
        asked = read_options(words)
        overrides, folder = list(asked.overrides), asked.config_dir
        if folder:
            require_harmless_folder(Path(folder))
        if asked.shell_completion and (found := own_completion(words, os.environ)) is not None:
            print(found)
            return 0
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
    from experiments.command_line.help_page import fitted, help_text

    text = fitted(help_text(words)) if sys.stdout.isatty() else help_text(words)
    print(text)
    return 0 if words else 2


def _print_version() -> int:
    from importlib import metadata

    print(f"ctus {metadata.version('ctus')}")
    return 0


def _show(asked: CallOptions, overrides: list[str], folder: str | None) -> int:
    """Print the configuration of every sweep point, or what Hydra tells of how it composes the first one."""
    from omegaconf import OmegaConf

    composed = _composed(overrides, folder, multirun=asked.multirun)
    if asked.info:
        words, _ = _sweep_points(overrides)[0]
        _call_hydra(["--info", asked.info, *cli_words.words_of_folder(folder), *words])
        return 0
    for config, label in composed:
        shown = _part(config, str(asked.cfg))
        with _as_input_error(overrides):
            if asked.resolve:
                OmegaConf.resolve(shown)
            if asked.package not in (None, "_global_"):
                shown = OmegaConf.select(shown, str(asked.package))
        heading = f"---\n# {label}\n" if len(composed) > 1 else ""
        print(heading + OmegaConf.to_yaml(shown), end="")
    return 0


def _part(config: DictConfig, kind: str) -> DictConfig:
    """The configuration of a job, that of Hydra, or both."""
    from omegaconf import OmegaConf

    if kind == "job":
        return _without_hydra(config)
    return OmegaConf.masked_copy(config, ["hydra"]) if kind == "hydra" else config


def _run(overrides: list[str], folder: str | None, *, multirun: bool) -> int:
    from experiments.command_line.call_checks import require_shared, require_writable
    from experiments.running import jobs, run_sweep

    points: SweepPoints = []
    try:
        points = compose_sweep(overrides, folder, multirun=multirun)
        for config, _ in points:
            require_shared(config)
        cli_words.note_useless_seed(config for config, _ in points)
        require_writable(jobs.out_folder(points[0][0], "0" * 64))
        return run_sweep.run(points)
    except user_errors() as refusal:
        print(refusal, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        settings = (
            "resume=true trainer.resume=true"
            if any("trainer" in each for each, _ in points)
            else "resume=true"
        )
        print(
            f"Stopped by the keyboard; what had finished is kept. Continue with the same command and {settings}.",
            file=sys.stderr,
        )
        return STOPPED


def compose_sweep(
    overrides: list[str], config_dir: str | None = None, *, multirun: bool = False
) -> SweepPoints:
    """Compose every point of a sweep (one point without ``multirun``): its resolved configuration and a label.

    Raises InputError for an unknown study, group option or setting, for a sweep over no value, and for a value that
    must be given and is not.

    Parameters
    ----------
    overrides : list[str]
        Settings as words of the form ``setting=value``.
    config_dir : str or None, optional
        The user's own folder of configurations.
    multirun : bool, optional
        Whether settings with several values are a sweep.

    Returns
    -------
    SweepPoints
        Resolved configuration and label of each sweep point.
    """
    composed = _composed(overrides, config_dir, multirun=multirun)
    with _as_input_error(overrides):
        called = shlex.join(["ctus", *(["-m"] if multirun else []), *cli_words.write_presets(overrides)])
        return [(resolve(config, called), label) for config, label in composed]


def _composed(
    overrides: list[str], config_dir: str | None, *, multirun: bool
) -> list[tuple[DictConfig, str]]:
    """Every point of a sweep as Hydra composes it, its own node included, and a label."""
    from hydra import initialize_config_dir

    _register_resolvers()
    _keep_names_as_text()
    overrides = [quoted_override(word) for word in cli_words.read_presets(overrides)]
    for word in overrides:
        cli_words.refuse_no_setting(word)
        _refuse_launcher(word)
    if config_dir:
        require_harmless_folder(Path(config_dir))
    _find_plugin_configs()
    with (
        initialize_config_dir(str(conf_dir()), version_base=HYDRA_VERSION_BASE),
        _as_input_error(overrides, _search_path(config_dir)),
    ):
        parsed = _parsed_overrides(overrides)
        several = next((override for override in parsed if override.is_sweep_override()), None)
        if not multirun and several is not None:
            raise InputError(
                f"{several.key_or_group}: expected -m (--multirun) before the settings for a job each, or [...] for a "
                f"list, received {several.input_line}"
            )
        plain = [str(override.input_line) for override in parsed if not override.is_sweep_override()]
        composer = _Composer(config_dir)
        base = composer(plain)
        if not multirun:
            return [(base, "")]
        preset = dict(base.hydra.sweeper.get("params") or {})
        words_of_points = _sweep_points([f"{key!s}={value}" for key, value in preset.items()] + overrides)
        return [(composer(words), label) for words, label in words_of_points]


class _Composer:
    """Hydra's composition, once for all points of a sweep that choose the same options and differ in values alone.

    To read the options' files and to merge them takes most of the time; values are set afterwards, by Hydra as well.

    Parameters
    ----------
    config_dir : str or None
        The user's own folder of configurations.
    """

    def __init__(self, config_dir: str | None) -> None:
        self._folder = config_dir
        self._composed: dict[tuple[str, ...], DictConfig] = {}

    def __call__(self, words: list[str]) -> DictConfig:
        """Compose the point of these overrides."""
        from hydra import compose
        from hydra._internal.config_loader_impl import ConfigLoaderImpl, get_overrides_dirname
        from hydra.core.global_hydra import GlobalHydra
        from hydra.core.override_parser.overrides_parser import OverridesParser

        loader = GlobalHydra.instance().config_loader()
        assert isinstance(loader, ConfigLoaderImpl)
        parsed = OverridesParser.create(config_loader=loader).parse_overrides(words)
        # Hydra's own words may bring options from elsewhere: then all is left to it.
        if any(each.is_hydra_override() for each in parsed):
            return compose("config", [*words, *_search_path(self._folder)], return_hydra_config=True)
        values = [each for each in parsed if self._is_value(each, loader)]
        choices = tuple(str(each.input_line) for each in parsed if each not in values)
        if choices not in self._composed:
            found = compose("config", [*choices, *_search_path(self._folder)], return_hydra_config=True)
            self._composed[choices] = found
        config = copy.deepcopy(self._composed[choices])
        ConfigLoaderImpl._apply_overrides_to_config(values, config)
        if values:
            config.hydra.overrides.task = words
            names = config.hydra.job.config.override_dirname
            config.hydra.job.override_dirname = get_overrides_dirname(
                overrides=parsed,
                kv_sep=names.kv_sep,
                item_sep=names.item_sep,
                exclude_keys=names.exclude_keys,
            )
        return config

    def _is_value(self, override: Override, loader: ConfigLoaderImpl) -> bool:
        """Whether Hydra takes it for a value, which no file of options is read for."""
        name = override.key_or_group
        of_user = self._folder is not None and (Path(self._folder) / name).is_dir()
        return isinstance(override.value(), dict) or not (of_user or loader.repository.group_exists(name))


def _search_path(config_dir: str | None) -> list[str]:
    return [f"hydra.searchpath=[file://{config_dir}]"] if config_dir else []


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
        loader = loader_with_text(fast_loader(plain()))

        def keeping() -> Any:
            return loader

        keeping.keeps_names = True  # type: ignore[attr-defined]
        _utils.get_yaml_loader = keeping


def resolve(config: DictConfig, command: str = "ctus") -> Mapping[str, Any]:
    """The resolved configuration as plain data, with the study's name under ``study`` and the words under ``call``.

    Parameters
    ----------
    config : DictConfig
        A composed configuration, Hydra's own node included.
    command : str, optional
        The command line that it was composed for.

    Returns
    -------
    Mapping[str, Any]
        Plain data, with the study's name under ``study``, and under ``call`` the command, the option of each group and
        the names of the settings that were set.
    """
    from omegaconf import OmegaConf

    study = config.hydra.runtime.choices.get("study")
    if study is None:
        from experiments.running.jobs import study_names

        raise InputError(
            f"study: expected one of {', '.join(study_names())}, received none; pass study=<name>"
        )
    call = {"command": command, **_called(config)}
    config = _without_hydra(config)
    missing = sorted(OmegaConf.missing_keys(config))
    if missing:
        raise InputError(
            f"study={study}: expected a value for {', '.join(missing)}; pass "
            f"{' '.join(f'{name}=<value>' for name in missing)}"
        )
    plain = OmegaConf.to_container(config, resolve=True)
    assert isinstance(plain, dict)
    return {"study": study, **{str(key): value for key, value in plain.items()}, "call": call}


def _called(config: DictConfig) -> dict[str, Any]:
    """The option of each group, by the setting that it fills, and the settings that the command line set."""
    from omegaconf import ListConfig

    options = {}
    for group, chosen in config.hydra.runtime.choices.items():
        name = str(group).partition("@")[2] or str(group)
        # A part of an option (trainer/recipe), what is Hydra's own and where the jobs run fill no setting of the study.
        if (
            "/" not in str(group)
            and name != "launcher"
            and chosen is not None
            and name in {*config, "preset", "sweep"}
        ):
            options[name] = ", ".join(chosen) if isinstance(chosen, (list, ListConfig)) else str(chosen)
    words = [str(word).lstrip("+").partition("=")[0] for word in config.hydra.overrides.task]
    return {"options": options, "settings": [name for name in words if "@" not in name and "~" not in name]}


def _without_hydra(config: DictConfig) -> DictConfig:
    from omegaconf import OmegaConf, open_dict

    with open_dict(config):
        return OmegaConf.masked_copy(config, [str(key) for key in config if key != "hydra"])


def _sweep_points(overrides: list[str]) -> list[tuple[list[str], str]]:
    """The overrides of every sweep point, and a label made of those that vary: every combination of their values."""
    settings: dict[str, list[str]] = {}
    varying = set()
    for override in _parsed_overrides(overrides):
        key = override.get_key_element()
        if not override.is_sweep_override():
            values = [override.get_value_element_as_str()]
        elif override.is_discrete_sweep():
            values = list(override.sweep_string_iterator())
        else:
            raise InputError(
                f"{key}: expected values to sweep over (a,b, range(...), glob(...)), received {override.input_line}"
            )
        settings[key] = [f"{key}={value}" for value in values]
        varying |= {key} if override.is_sweep_override() else set()
    names = list(settings)
    return [
        (list(words), ",".join(word for name, word in zip(names, words, strict=True) if name in varying))
        for words in itertools.product(*settings.values())
    ]


def _refuse_launcher(word: str) -> None:
    name = word.lstrip("+~").partition("=")[0]
    if name in NOT_CHOSEN or name.startswith(tuple(f"{each.replace('/', '.')}." for each in NOT_CHOSEN)):
        raise InputError(
            f"{name}: expected none, because a sweep is every combination and its jobs are started by ctus itself; "
            "jobs=<number> runs as many at the same time, launcher=slurm on a cluster"
        )


def _find_plugin_configs() -> None:
    """Have Hydra look for options in the folders of plugins too, whenever it composes a configuration."""
    from hydra.core.config_search_path import ConfigSearchPath
    from hydra.core.plugins import Plugins
    from hydra.plugins.search_path_plugin import SearchPathPlugin

    known = {kind.__name__ for kind in Plugins.instance().discover(SearchPathPlugin)}

    class CtusPluginConfigs(SearchPathPlugin):
        def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
            for folder in plugin_config_folders():
                search_path.append("ctus.plugins", f"file://{folder}")

    if CtusPluginConfigs.__name__ not in known:
        Plugins.instance().register(CtusPluginConfigs)


def _call_hydra(words: list[str]) -> None:
    """Have Hydra print its help, its completion or its information; its entry point reads words from ``sys.argv``."""
    import hydra

    _register_resolvers()
    _keep_names_as_text()
    _find_plugin_configs()

    @hydra.main(version_base=HYDRA_VERSION_BASE, config_path=str(conf_dir()), config_name="config")
    def nothing(config: DictConfig) -> None:
        del config

    before = sys.argv
    sys.argv = [before[0] if before else "ctus", *words]
    try:
        nothing()
    finally:
        sys.argv = before


if __name__ == "__main__":
    sys.exit(main())
