"""What holds for the figures of every study."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from figure_labels import labels
from matplotlib.figure import Figure

from experiments.outcome import Outcome


@pytest.fixture(autouse=True)
def _figures_speak_in_plain_words(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Whatever a study hands over: no label of an axis and no legend is the name of a column or an option."""
    drawn: dict[str, Figure] = {}
    make = Outcome.__init__

    def watched(self: Outcome, *given: Any, **named: Any) -> None:
        make(self, *given, **named)
        drawn.update(self.figures)

    monkeypatch.setattr(Outcome, "__init__", watched)
    yield
    for name, figure in drawn.items():
        assert not [text for text in labels(figure) if "_" in text], name
