"""What the words of a call mean before Hydra reads them, and the error for a word that means nothing."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import yaml

from experiments.errors import InputError, did_you_mean, no_such_option
from experiments.plugins import config_folders, option_file, options_of


def read_presets(words: Sequence[str]) -> list[str]:
    """Read ``+sweep=<name>`` as the group of presets.

    Parameters
    ----------
    words : sequence of str
        Words of the command line.

    Returns
    -------
    list of str
        The words with ``+preset=<name>`` in its place.

    Notes
    -----
    A group can't be called ``sweep`` itself: Hydra would take the setting ``sweep=<recording>`` of the
    studies that read one for an option of that group.
    """
    return [
        f"+preset={word.removeprefix('+sweep=')}" if word.startswith("+sweep=") else word for word in words
    ]


def write_presets(words: Sequence[str]) -> list[str]:
    """Write the group of presets as the documentation calls it: what ``read_presets`` reads.

    Parameters
    ----------
    words : sequence of str
        Words of the command line.

    Returns
    -------
    list of str
        The words with ``+sweep=<name>`` in place of ``+preset=<name>``.
    """
    return [
        f"+sweep={word.removeprefix('+preset=')}" if word.startswith("+preset=") else word for word in words
    ]


def refuse_no_setting(word: str) -> None:
    """Refuse a word without ``=`` or without a name before it, for which Hydra's own message would be no help.

    Parameters
    ----------
    word : str
        Word of the command line.

    Raises
    ------
    InputError
        If the word has no ``=`` and does not delete a setting (``~``), or names no setting.
    """
    if not word.partition("=")[0].strip("+~ "):
        raise InputError(
            f"{word or repr(word)}: expected setting=value, received a word without a setting's name"
        )
    if "=" in word or word.startswith("~"):
        return
    hint = (
        did_you_mean(word, ["doctor", "demo"], "ctus ")
        or did_you_mean(word, options_of("study"), "study=")
        or did_you_mean(word, _groups())
    )
    raise InputError(f"{word}: expected setting=value, received a word without ={hint}")


def refuse_no_option(group: str, value: Any) -> None:
    """Refuse a choice that can't be the name of an option, such as a number or null.

    Parameters
    ----------
    group : str
        Name of a setting; nothing is checked if it is no group.
    value : Any
        Its value as plain data.

    Raises
    ------
    InputError
        If the value is neither a text nor a list of texts.
    """
    if group not in group_names() or isinstance(value, str):
        return
    if isinstance(value, list) and all(isinstance(each, str) for each in value):
        return
    raise InputError(no_such_option(group, value, options_of(group)))


def group_names() -> frozenset[str]:
    """List the folders that hold options to choose from, the studies among them.

    Returns
    -------
    frozenset[str]
        Names of the folders.
    """
    return frozenset(_groups())


def setting_names(config: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """List the dotted names of all settings of a composed configuration, those of mappings among them.

    Parameters
    ----------
    config : Mapping[str, Any]
        The configuration as plain data.
    prefix : str, optional
        Put before every name; empty at the top, where Hydra's own settings are left out.

    Yields
    ------
    str
        Dotted name of each setting.
    """
    for key, value in config.items():
        if prefix or key != "hydra":
            yield f"{prefix}{key}"
        if isinstance(value, Mapping) and (prefix or key != "hydra"):
            yield from setting_names(value, f"{prefix}{key}.")


def draws_nothing(study: str) -> bool:
    """Tell whether a study declares by ``seed: null`` in its configuration that nothing in it is random.

    Parameters
    ----------
    study : str
        Name of the study.

    Returns
    -------
    bool
        True if it does; False also if there is no such study.
    """
    path = option_file("study", study)
    content = yaml.safe_load(path.read_text(encoding="utf-8")) if path is not None else None
    return isinstance(content, Mapping) and content.get("seed", 0) is None


def sentence(refusal: Exception, study: str | None, known: Sequence[str]) -> str:
    """Turn Hydra's message into one sentence that says what was expected and found.

    Parameters
    ----------
    refusal : Exception
        Exception of Hydra.
    study : str or None
        Name of the study; None if none is chosen.
    known : sequence of str
        Names of the settings there are, with which a misspelt one is compared.

    Returns
    -------
    str
        The sentence.
    """
    lines = [line.strip() for line in str(refusal).splitlines() if line.strip()]
    first = lines[0] if lines else type(refusal).__name__
    # An option that there is not is a field of Hydra's exception, but words alone where it stood in a list of options.
    in_list = re.search(r"Could not load '([^']+)'", first)
    missing = str(getattr(refusal, "missing_cfg_file", None) or (in_list[1] if in_list else ""))
    if "/" in missing:
        group, _, option = missing.rpartition("/")
        options = getattr(refusal, "options", None) or options_of(group)
        if options:
            return no_such_option(group, option, options)
    # Hydra says so of a setting, of a group that the study has no choice in, and of a misplaced package alike.
    unknown = re.match(r"Could not override '([^']+)'", first)
    if unknown is not None:
        name = unknown[1]
        return (
            f"Could not override '{name}': expected a setting of the study (ctus study={study or '<name>'} --help "
            f"lists them){did_you_mean(name, [each for each in known if each != name])}"
        )
    return "; ".join(lines)


def note_useless_seed(configs: Iterable[Mapping[str, Any]]) -> None:
    """Say on standard error, once, that a seed was given to a study that draws nothing at random.

    Parameters
    ----------
    configs : iterable of Mapping[str, Any]
        Configurations of the sweep points.
    """
    for config in configs:
        if config.get("seed") is not None and draws_nothing(config["study"]):
            print(
                f"seed: study={config['study']} draws nothing at random, so that seed={config['seed']} changes no "
                "result.",
                file=sys.stderr,
            )
            return


def words_of_folder(folder: str | None) -> list[str]:
    """Make the words that pass a folder of configurations on to Hydra.

    Parameters
    ----------
    folder : str or None
        The folder; None if there is none.

    Returns
    -------
    list of str
        The words; empty if there is no folder.
    """
    return ["--config-dir", folder] if folder else []


def _groups() -> list[str]:
    paths = (path for folder in config_folders() for path in folder.iterdir())
    return sorted({path.name for path in paths if path.is_dir() and any(path.glob("*.yaml"))})
