"""Which settings are paths: of every study and option, and never by what happens to lie in the current folder."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from configurations import CONF, STUDIES, composed, mandatory

from experiments import registry
from experiments.cli import compose_sweep
from experiments.running import jobs
from experiments.running.path_settings import is_path, named_paths, words_of

TARGETS = sorted(
    {name for path in CONF.rglob("*.yaml") for name in re.findall(r"_target_: ([\w.]+)", path.read_text())}
)
# The settings of the studies that name what a job reads.
OF_STUDIES = {
    "accuracy": {"model_path"},
    "calibrate_spatial": {"results", "device_set"},
    "calibrate_stylus": {"sweep"},
    "calibrate_temporal": {"sweep"},
    "centerline": {"mesh", "ends"},
    "consistency": {"model_path"},
    "convert": {"input"},
    "ct_model": {"input"},
    "evaluate": {"prediction", "reference", "targets"},
    "inspect_sweep": {"sweep"},
    "pipeline": {"model_path"},
    "reconstruct": {"sweep", "masks", "model_path"},
    "record_sweep": {"calibration"},
    "register": {
        *("moving", "fixed", "initial", "moving_landmarks", "fixed_landmarks"),
        *("moving_centerline", "fixed_centerline", "truth", "carry"),
    },
    "export_model": {"model_path"},
    "propagation": {"model_paths"},
    "runtime": {"model_path"},
    "segment": {"model_path", "input"},
    "robustness": {"target", "moving", "moving_truth", "target_centerline"},
}
OF_CLASSES = {
    "Carotid": {"root"},
    "Folder": {"root"},
    "MusV": {"root", "subjects"},
    "Pretrained": {"path"},
    "NnUNet": {"root", "groups"},
    "SanRaffaele": {"root"},
    "Usgra": {"root"},
    "GroupSplits": {"file"},
    "LiveRecorder": {"calibration"},
    "PhantomSettings": {"mesh"},
    "PlusReader": {"device_set", "tracker"},
    "RosbagReader": {"calibration"},
}
# Settings that may be text and name nothing that a job reads: words, names, and where results and caches go. A new
# setting that takes text must be put here or be known as a path.
_WORDS = """
    archive cache out store experiments format title subset phantoms places rotations train_on probe phantom_frame
    space units spacing_mm rigid factors filters moving_unit fixed_unit moving_space fixed_space label unpaired
    target district group_by session prune_by subsample_to test_subjects selection_groups test_groups schedule
    accelerator precision normalisation sector overlays network refine_by rotation place missing loss geometry
    interpolation compounding image_topic pose_topic world ee tf_topics out_of_order image clock orientation
    selection late_weights image_device pose_device host nifti_form prediction_label ignore_label ignored times
    transforms deformable model_side residual device configurations vessels districts run runs unit data_root
    sources motion strategy slicer
"""
WORDS = {
    *_WORDS.split(),
    "root of rigid_benchmark",
    "blocks of rigid_benchmark",
    "calibration of consolidation",
    "register_as of export_model",
    "masks of consistency",
    "masks of accuracy",
    "masks of runtime",
    "reference of calibrate_spatial",
    "settings of MonaiNetwork",
}


def parameters(callable_: Any) -> Iterator[tuple[str, str]]:
    for name, parameter in inspect.signature(callable_).parameters.items():
        if name not in jobs.INJECTED:
            yield name, str(parameter.annotation)


def unclassified(where: str, callable_: Any, paths: set[str]) -> list[str]:
    """The settings that take text and are neither known as paths nor listed as words; and false claims of either."""
    wrong = []
    for name, annotation in parameters(callable_):
        said = is_path(annotation)
        if said != (name in paths):
            wrong.append(f"{where}.{name}: {annotation}")
        takes_text = "str" in annotation or "Any" in annotation
        if takes_text and not said and not {name, f"{name} of {where}"} & WORDS:
            wrong.append(f"{where}.{name}: {annotation}")
    return wrong


@pytest.mark.parametrize("study", STUDIES)
def test_every_setting_of_a_study_that_takes_text_is_known_as_a_path_or_a_word(study: str) -> None:
    module = jobs.study_module(study)
    wrong = unclassified(
        study, module.run, OF_STUDIES.get(study, set()) & {n for n, _ in parameters(module.run)}
    )
    assert not wrong
    if hasattr(module, "check"):
        own = OF_STUDIES.get(study, set()) & {name for name, _ in parameters(module.check)}
        assert not unclassified(study, module.check, own)


@pytest.mark.parametrize("target", TARGETS)
def test_every_setting_of_an_option_that_takes_text_is_known_as_a_path_or_a_word(target: str) -> None:
    cls = registry.load(target)
    assert not unclassified(cls.__name__, cls, OF_CLASSES.get(cls.__name__, set()))


def filled(config: Any, paths: set[str], place: str = "") -> Any:
    """The configuration with a path in every setting of these names, as a user might give it."""
    if isinstance(config, Mapping):
        fields = OF_CLASSES.get(str(config.get("_target_", "")).rsplit(".", 1)[-1], set())
        return {
            key: f"/given{place}.{key}" if key in fields | (paths if not place else set())
            else filled(value, set(), f"{place}.{key}")
            for key, value in config.items()
        }  # fmt: skip
    return config


def given(config: Any) -> Iterator[str]:
    if isinstance(config, str) and config.startswith("/given"):
        yield config
    elif isinstance(config, Mapping):
        for value in config.values():
            yield from given(value)


@pytest.mark.parametrize("study", STUDIES)
def test_every_path_in_a_studys_configuration_is_found(study: str) -> None:
    groups = ["dataset", "acquisition"] if study != "domain_transfer" else ["dataset@first"]
    text = (CONF / "study" / f"{study}.yaml").read_text()
    options = [
        [f"{group}={path.stem}"]
        for group in groups
        if f"/{group}:" in text
        for path in sorted((CONF / group.split("@")[0]).glob("*.yaml"))
    ]
    for option in options or [[]]:
        config = composed(f"study={study}", *option, *mandatory(study))
        config = filled(config, OF_STUDIES.get(study, set()))
        module = jobs.study_module(study)
        takers = [getattr(module, name) for name in ("run", "check") if hasattr(module, name)]
        assert sorted(named_paths(config, takers).values()) == sorted(given(config))
        assert set(named_paths(config, takers).values()) <= set(jobs.read_paths(config))


def test_a_word_is_no_path_whatever_lies_in_the_current_folder(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(home)
    for name in ("moving.ply", "fixed.ply"):
        (home / name).write_text("ply")
    words = ["study=register", "moving=moving.ply", "fixed=fixed.ply", "moving_centerline=none"]
    ((config, _),) = compose_sweep(words)
    before = jobs.hash_now(config)
    for name in ("plane", "none", "mm", "lps", "register"):
        (home / name).write_text("a file that happens to be called so")
    assert jobs.hash_now(config) == before
    (home / "moving.ply").write_text("other")
    assert jobs.hash_now(config) != before


def test_lists_and_mappings_of_paths_are_taken_apart() -> None:
    def run(*, target: str | Path, views: Mapping[str, Path], name: str) -> None: ...

    config = {"target": ["/a", "/b"], "views": {"x": "/c", "y": None}, "name": "/d", "other": {"z": "/e"}}
    assert named_paths(config, [run]) == {"target[0]": "/a", "target[1]": "/b", "views.x": "/c"}


def test_annotations_say_what_is_a_path() -> None:
    @dataclasses.dataclass
    class Part:
        folder: Path
        word: str
        many: list[Path] | None = None

    annotations = {
        name: parameter.annotation for name, parameter in inspect.signature(Part).parameters.items()
    }
    assert [is_path(annotations[name]) for name in ("folder", "word", "many")] == [True, False, True]
    assert is_path(Path)
    assert is_path(Path | None)
    assert not is_path(inspect.Parameter.empty)
    assert not is_path("PathologyReport")
    assert words_of("PathSetting | Literal['none', \"all\"] | None") == {"none", "all"}


def test_a_centerline_beside_a_surface_and_the_cases_around_a_truth_are_read_too(home: Path) -> None:
    for name in ("aorta.ply", "aorta-centerline.vtp", "cloud.ply"):
        (home / name).write_text(name)
    config = {"study": "register", "moving": str(home / "cloud.ply"), "fixed": str(home / "aorta.ply")}
    before = jobs.hash_now(config)
    (home / "aorta-centerline.vtp").write_text("other")
    assert jobs.hash_now(config) != before
    assert jobs.hash_now({**config, "fixed_centerline": "none"}) != jobs.hash_now(config)
    cases = home / "cases"
    (cases / "truth").mkdir(parents=True)
    (cases / "one").mkdir()
    scored = {"study": "evaluate", "prediction": str(home / "cloud.ply"), "reference": str(cases / "truth")}
    before = jobs.hash_now(scored)
    (cases / "one" / "case.json").write_text("{}")
    assert jobs.hash_now(scored) != before
