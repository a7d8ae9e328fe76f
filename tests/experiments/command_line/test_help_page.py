"""The page of a study: its own settings, and those of the options that a call chooses."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from configurations import OPTIONS, composed, mandatory, taker

from experiments.cli import main
from experiments.command_line.help_page import fitted, help_text
from experiments.command_line.options import option_text
from experiments.command_line.words import setting_names
from experiments.errors import InputError
from experiments.paths import conf_dir
from experiments.tracking.names import flatten


def test_the_page_shows_the_settings_of_the_options_chosen() -> None:
    page = help_text(["study=segmentation", "model=unet3plus", "split=nested", "--help"])
    assert "  deep_supervision: false" in page and "# model=unet3plus   (of attention_unet|" in page
    assert "# dataset=phantom" in page and "frames_per_sweep: 30" in page
    # What the option is built on, with its own values and the comments that belong to them.
    assert "  outer_folds: 5" in page and "  selection_share: 0.2   # share of the cases" in page
    assert "  validation_parts: 5    # of the groups" in page and "outer_folds: null" not in page
    assert "defaults:" not in page and "@package" not in page
    assert "deep_supervision" not in help_text(["study=segmentation"])


def test_a_bare_name_lists_and_presets_choose_too(tmp_path: Path) -> None:
    assert "moving_points: 3000" in help_text(["register", "--help"])
    page = help_text(["+preset=robustness_small", "--help"])
    assert "study=robustness" in page and "# rigid=single_icp_plane" in page and "trials: 2" in page
    page = help_text(["study=register", "rigid=[gicp,fpfh_fgr]"])
    assert "# rigid=gicp" in page and "# rigid=fpfh_fgr" in page and "multistart:" not in page
    page = help_text(["study=domain_transfer", "dataset@second=carotid"])
    assert "# dataset@first=phantom" in page and "second:\n  # Common Carotid" in page


@pytest.mark.parametrize("spelling", ["--config-dir={}", "--config-dir {}"])
def test_options_of_ones_own_are_shown(spelling: str, tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "mine.yaml").write_text("# Mine.\nmy_setting: 3\n")
    words = ["study=segmentation", "model=mine", *spelling.format(tmp_path).split(" ")]
    assert "  my_setting: 3" in help_text(words)


def test_an_option_that_there_is_not_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="received 'unett'; did you mean unet"):
        help_text(["study=segmentation", "model=unett"])
    assert main(["study=segmentaton", "--help"]) == 2
    assert "did you mean segmentation?" in capsys.readouterr().err


@pytest.mark.parametrize("group, option", OPTIONS)
def test_what_is_shown_of_an_option_is_what_is_composed(group: str, option: str) -> None:
    study = taker(group)
    config = composed(f"study={study}", f"{group}={option}", *mandatory(study))
    shown = yaml.safe_load(option_text(group, option, group, [conf_dir()]))
    assert set(setting_names(shown)) <= set(setting_names(config))
    # A study may set more of an option in its own file, which its page shows first.
    own = yaml.safe_load(option_text("study", study, "", [conf_dir()]))
    rest = set(setting_names(config)) - set(setting_names(shown)) - set(setting_names(own))
    # A part that follows another method's as a whole is shown by that reference.
    followed = [name for name, value in flatten(shown).items() if str(value).startswith("${")]
    rest -= {name for name in rest if name.startswith(tuple(f"{each}." for each in followed))}
    assert not [name for name in rest if name.startswith(f"{group}.")]


def test_on_a_terminal_the_page_is_no_wider_than_100_columns_and_says_the_same() -> None:
    page = help_text(["--help"])
    narrow = fitted(page)
    assert max(map(len, page.splitlines())) > 100 >= max(map(len, narrow.splitlines()))
    assert "".join(narrow.split()) == "".join(page.split())
    # Descriptions go on below themselves.
    lines = narrow.splitlines()
    (first,) = [number for number, line in enumerate(lines) if line.startswith("  accuracy ")]
    assert lines[first + 1].index(lines[first + 1].strip()) == lines[first].index("What is left")


def test_settings_with_their_comments_are_not_broken() -> None:
    line = f"  moving: ???             # {'a long comment ' * 10}"
    assert fitted(line) == line
