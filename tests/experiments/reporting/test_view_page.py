"""Parts of a page around a 3-D view: badges, buttons of layers, and JSON within a script."""

from __future__ import annotations

import json

import pytest

from experiments.reporting.view_page import badge, layer_button, script_json


@pytest.mark.parametrize(
    ("text", "kind", "look"),
    [
        ("accepted", None, "good"),
        ("failed", None, "bad"),
        ("ambiguous", None, "doubt"),
        ("no pose", "bad", "bad"),
    ],
)
def test_a_badge_looks_like_its_verdict(text: str, kind: str | None, look: str) -> None:
    assert badge(text, kind) == f' <span class="badge {look}">{text}</span>'
    assert badge("", kind) == ""


def test_a_button_says_whether_its_layer_is_shown_and_in_which_colour() -> None:
    shown, hidden = layer_button("<fixed>", "#123456", True), layer_button("line", "Plasma", False)
    assert 'aria-pressed="true"' in shown
    assert "background: #123456" in shown
    assert "&lt;fixed&gt;" in shown
    assert 'aria-pressed="false"' in hidden
    assert "linear-gradient" in hidden


def test_json_does_not_end_the_script_that_it_is_in() -> None:
    text = script_json({"name": "</script>"})
    assert "</" not in text
    assert json.loads(text) == {"name": "</script>"}
