"""The model card of a model file: what it is, what it was made from, how it was tested, and what it is not for.

M. Mitchell et al., Model Cards for Model Reporting, FAT* 2019.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from models.model_file import SegmentationModel

NOT_KNOWN = "not recorded"
# Columns of the table of data first, whatever else a file has after them.
DATA_COLUMNS = ("licence", "digest", "groups", "images")


def model_card(model: SegmentationModel, title: str) -> str:
    """Write the card of a model.

    Parameters
    ----------
    model : SegmentationModel
        The model; its ``notes`` may hold measured scores as ``scores``, a mapping of names to values or to mappings.
    title : str
        Heading.

    Returns
    -------
    str
        Markdown.
    """
    blocks = (
        _what(model, title),
        ["## Data", "", *_data(model.data)],
        ["## Certificate", "", *_certificate(model.certificate)],
        ["## From probability to mask", "", *_settings(model)],
        ["## Measured", "", *_scores(model.notes.get("scores"))],
        ["## Limits", "", *(f"- {limit}" for limit in _limits(model))],
        ["## Use", "", *_use()],
    )
    return "\n".join(line for block in blocks for line in (*block, ""))


def _what(model: SegmentationModel, title: str) -> list[str]:
    count = len(model.members)
    kind = "one network" if count == 1 else f"an ensemble of {count} networks (mean probability)"
    rows = [[member.name, str(member.recipe), f"{member.parameters / 1e6:.2f} M"] for member in model.members]
    side = model.preprocessing.image_size_px
    return [
        f"# {title}",
        "",
        f"Segments vessels in two-dimensional ultrasound frames: {kind}, frames brought to {side} x {side} px. "
        f"Digest `{model.digest}`.",
        "",
        *_table(["network", "architecture", "values"], rows),
        "",
        f"Preprocessing: {_inline(dataclasses.asdict(model.preprocessing))}.",
    ]


def _data(data: Mapping[str, Any]) -> list[str]:
    if not data:
        return ["Which data the model was trained on is not recorded."]
    facts = {name: value if isinstance(value, Mapping) else {"about": value} for name, value in data.items()}
    further = dict.fromkeys(key for about in facts.values() for key in about if key not in DATA_COLUMNS)
    columns = [key for key in (*DATA_COLUMNS, *further) if any(key in about for about in facts.values())]
    columns = list(dict.fromkeys(("licence", *columns)))
    rows = [[name, *(_text(about.get(key, NOT_KNOWN)) for key in columns)] for name, about in facts.items()]
    return _table(["data set", *columns], rows)


def _certificate(certificate: Mapping[str, Any]) -> list[str]:
    if not certificate:
        return ["None: nobody has recorded how this model was chosen and on whom it was tested."]
    return [f"- {name}: {value}" for name, value in _flat(certificate)]


def _settings(model: SegmentationModel) -> list[str]:
    calibration, option = model.calibration, model.postprocessing
    lines = [
        "- calibration: none"
        if calibration is None
        else f"- calibration: temperature {calibration.temperature:.4g}, bias {calibration.bias:.4g}",
        "- thresholds: 0.5"
        if option is None
        else f"- thresholds: {_inline(dataclasses.asdict(option.hysteresis))}",
    ]
    if option is not None:
        lines.append(f"- morphology: {_inline(dataclasses.asdict(option.morphology))}")
    gate = "none" if model.min_presence is None else f"presence of at least {model.min_presence:.3g}"
    return [*lines, f"- presence gate: {gate}", f"- mirror image at test time: {_text(model.flips)}"]


def _scores(scores: Any) -> list[str]:
    if not isinstance(scores, Mapping) or not scores:
        return ["No score is recorded in this file."]
    if all(isinstance(value, Mapping) for value in scores.values()):
        columns = list(dict.fromkeys(key for each in scores.values() for key in each))
        rows = [[name, *(_text(each.get(key, "")) for key in columns)] for name, each in scores.items()]
        return _table(["of", *columns], rows)
    return _table(["score", "value"], [[name, value] for name, value in _flat(scores)])


def _limits(model: SegmentationModel) -> Iterator[str]:
    yield "Research software: no medical device, and not for diagnosis or treatment."
    yield "Scores hold for the scanners, anatomy and people of the data above; other ones have to be measured."
    if not model.certificate:
        yield "There is no certificate: treat every mask as untested."
    if not model.data:
        yield "The data and so their licence are unknown: ask its maker before you pass the model on."
    if any(isinstance(about, Mapping) and about.get("simulated") for about in model.data.values()):
        yield "Some of the data were simulated."
    if model.calibration is None:
        yield "Probabilities are not calibrated: a value of 0.9 need not be right in 9 of 10 cases."
    if model.min_presence is None:
        yield "Nothing but the thresholds keeps masks from frames without a vessel: look at the false alarms."
    option = model.postprocessing
    if option is not None and option.morphology.min_area_mm2 and option.morphology.min_area_px is None:
        yield "Small components are removed by area in mm^2: frames need a known pixel size."


def _use() -> list[str]:
    return [
        "```",
        "ctus study=segment model_path=model.pt input=FOLDER out=MASKS",
        "```",
        "",
        "or `models.predictor.Predictor.load(path)(frames)` in Python.",
    ]


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    cells = [list(columns), ["---"] * len(columns), *rows]
    return ["| " + " | ".join(each.replace("|", "\\|") for each in row) + " |" for row in cells]


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}, ")
        else:
            yield f"{prefix}{name}", _text(value)


def _inline(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {_text(value)}" for name, value in values.items() if value is not None)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        return _inline(value)
    if isinstance(value, (list, tuple)):
        return ", ".join(_text(each) for each in value)
    return NOT_KNOWN if value is None else str(value)
