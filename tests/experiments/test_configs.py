"""Every configuration file composes, what it names can be built, and it shows every setting that there is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any

import pytest
from configurations import CONF, OPTIONS, STUDIES, composed, mandatory

from experiments import registry
from experiments.cli import compose_sweep
from experiments.errors import InputError
from experiments.running import jobs


@pytest.mark.parametrize("study", STUDIES)
def test_a_study_composes_and_its_parts_build(study: str) -> None:
    config = composed(f"study={study}", *mandatory(study))
    for job, _ in jobs.job_configs(config):
        assert jobs.arguments(job)


@pytest.mark.parametrize("group, option", OPTIONS)
def test_an_option_composes_and_builds_in_a_study_that_takes_it(group: str, option: str) -> None:
    takers = [study for study in STUDIES if f"/{group}:" in (CONF / "study" / f"{study}.yaml").read_text()]
    assert takers, f"no study takes the group {group}"
    config = composed(f"study={takers[0]}", f"{group}={option}", *mandatory(takers[0]))
    assert registry.build(config[group], group)


def test_a_configuration_file_stays_short() -> None:
    # What was published and what the thesis runs are tables, no options.
    files = [path for path in CONF.rglob("*.yaml") if path.name not in ("published.yaml", "thesis.yaml")]
    long = [str(path) for path in files if len(path.read_text().splitlines()) > 60]
    assert not long


# What an option sets on purpose to another value than the class has; all else is the class's own default.
MEANT = {
    ("acquisition", "auto"): {"ros2.pose_topic"},
    ("acquisition", "ros2"): {"pose_topic"},
    ("acquisition", "plus_stylus"): {"ee", "uncalibrated"},
    ("augmentation", "none"): {"transforms"},
    ("augmentation", "strong"): {
        "transforms",
        *(f"transforms.0.{name}" for name in ("probability", "max_rotation_deg", "max_scale_change")),
        *(f"transforms.0.{name}" for name in ("max_shift", "max_shear")),
        *(f"transforms.{place}.probability" for place in range(2, 8)),
    },
    ("dataset", "carotid"): {"cache", "substitute.subjects", "substitute.strength", "substitute.workers"},
    ("dataset", "musv_artery"): {"cache", "substitute.recordings", "substitute.workers"},
    ("dataset", "musv_vein"): {"cache", "substitute.recordings", "substitute.workers"},
    ("dataset", "nnunet"): {"cache"},
    ("dataset", "phantom"): {"workers"},
    ("dataset", "san_raffaele"): {"cache", "substitute.frames", "substitute.workers"},
    ("dataset", "usgra"): {
        *("cache", "substitute.subjects", "substitute.recordings", "substitute.frames", "substitute.workers"),
    },
    ("deformable", "cpd_point"): {"cpd_point.residual"},
    ("filters", "default"): {"statistical.deviations"},
    ("loss", "focal_tversky"): {"gamma"},
    ("model", "attention_unet"): {"width", "normalisation"},
    ("model", "basic_unet"): {"width"},
    ("model", "unet"): {"width", "normalisation"},
    ("model", "unet3plus"): {"width", "normalisation"},
    ("perturbation", "binned"): {"angle_bin_deg"},
    ("perturbation", "missing"): {"missing_share"},
    ("phantom", "artificial"): {"subset"},
    ("phantom", "random"): {"subset"},
    ("phantom", "vein"): {"subset"},
    ("preprocessing", "clean"): {"normalisation", "sector", "overlays"},
    **{("surface", option): {"largest"} for option in ("ball_pivoting", "poisson", "signed_distance")},
    ("rigid", "fpfh_fgr"): {"fpfh_fgr.refine.refine_by", "fpfh_fgr.refine.keep"},
    ("rigid", "fpfh_ransac"): {"fpfh_ransac.refine.refine_by", "fpfh_ransac.refine.keep"},
    ("rigid", "kiss_matcher"): {"kiss_matcher.refine.refine_by", "kiss_matcher.refine.keep"},
    ("rigid", "multistart_no_centerline"): {"multistart_no_centerline.starts.use_centerline"},
    ("rigid", "multistart_no_inversion"): {"multistart_no_inversion.starts.invert"},
    ("rigid", "multistart_no_offset"): {"multistart_no_offset.wall_offset"},
    ("rigid", "multistart_no_pruning"): {
        f"multistart_no_pruning.stages.{name}" for name in ("first_share", "survivors", "finalists")
    },
    ("rigid", "multistart_no_slide"): {"multistart_no_slide.starts.slide"},
    ("rigid", "multistart_one_start"): {
        f"multistart_one_start.starts.{name}"
        for name in ("rolls", "axis_share", "compact_share", "invert", "slide")
    },
    ("rigid", "single_icp_centred"): {"single_icp_centred.align_centroids"},
    ("rigid", "single_icp_plane"): {"single_icp_plane.refine_by"},
    ("split", "nested"): {"outer_folds", "selection_share"},
    ("split", "three_way"): {"folds", "selection_share", "test_share"},
    ("trainer", "gpu"): {"warmup_epochs", "accelerator", "precision"},
    ("trainer", "demo"): {"threads"},
    ("trainer", "smoke"): {"smoke", "threads"},
}


def parts(node: Any, where: str = "") -> Iterator[tuple[str, type, Mapping[str, Any]]]:
    """Every part of a composed option that names a class: where it stands, the class, and its settings."""
    if isinstance(node, list):
        node = {str(place): inner for place, inner in enumerate(node)}
    if not isinstance(node, Mapping):
        return
    if "_target_" in node:
        yield where, registry.load(node["_target_"]), node
    for name, inner in node.items():
        yield from parts(inner, f"{where}.{name}".lstrip("."))


def option_of(group: str, option: str) -> Any:
    takers = [study for study in STUDIES if f"/{group}:" in (CONF / "study" / f"{study}.yaml").read_text()]
    # The first one for phantoms changes two of their settings for itself.
    return composed(f"study={takers[-1]}", f"{group}={option}", *mandatory(takers[-1]))[group]


@pytest.mark.parametrize("group, option", OPTIONS)
def test_an_option_shows_every_setting_of_its_classes(group: str, option: str) -> None:
    for where, kind, settings in parts(option_of(group, option)):
        assert is_dataclass(kind), kind
        known = {one.name for one in fields(kind) if one.init}
        assert set(settings) - {"_target_"} == known, f"{group}={option} {where}"


@pytest.mark.parametrize("group, option", OPTIONS)
def test_an_option_differs_from_its_class_where_it_means_to(group: str, option: str) -> None:
    differing = set()
    for where, kind, settings in parts(option_of(group, option)):
        built = registry.build(settings, where)
        for one in fields(kind):
            default = one.default if one.default_factory is MISSING else one.default_factory()
            value = getattr(built, one.name)
            # A folder of the project is named from its top in a class and in full in a configuration.
            same_place = isinstance(value, str) and isinstance(default, str) and value.endswith(f"/{default}")
            value, default = (tuple(one) if isinstance(one, list) else one for one in (value, default))
            if default is not MISSING and not is_dataclass(default) and value != default and not same_place:
                differing.add(f"{where}.{one.name}".lstrip("."))
    assert differing == MEANT.get((group, option), set())


def test_a_study_shows_every_setting_of_the_parts_it_names_itself() -> None:
    for study in STUDIES:
        for where, kind, settings in parts(composed(f"study={study}", *mandatory(study))):
            known = {one.name for one in fields(kind) if one.init}
            assert set(settings) - {"_target_"} == known, f"{study}: {where}"


def leaves(node: Mapping[str, Any], where: str = "") -> dict[str, Any]:
    """Every setting of a method by its dotted name."""
    found: dict[str, Any] = {}
    for name, value in node.items():
        found |= leaves(value, f"{where}{name}.") if isinstance(value, Mapping) else {where + name: value}
    return found


ABLATIONS = sorted(path.stem for path in (CONF / "rigid").glob("multistart_*.yaml"))


@pytest.mark.parametrize("ablation", ABLATIONS)
@pytest.mark.parametrize("order", ["{0},multistart", "multistart,{0}"])
def test_an_ablation_follows_what_is_set_for_multistart(ablation: str, order: str) -> None:
    words = [
        "study=robustness",
        f"rigid=[{order.format(ablation)}]",
        "rigid.multistart.stages.fine_points=4321",
    ]
    words += ["rigid.multistart.acceptance.max_tre_mm=1.5", "rigid.multistart.kernel=null"]
    ((plain, _),) = compose_sweep(["study=robustness", f"rigid=[multistart,{ablation}]"])
    ((config, _),) = compose_sweep(words)
    meant = {name.split(".", 1)[1] for name in MEANT["rigid", ablation]}
    for rigid in (plain["rigid"], config["rigid"]):
        own, whole = leaves(rigid[ablation]), leaves(rigid["multistart"])
        assert {name for name in whole | own if own[name] != whole[name]} == meant
    assert config["rigid"][ablation]["stages"]["fine_points"] == 4321
    assert config["rigid"][ablation]["acceptance"]["max_tre_mm"] == 1.5
    assert config["rigid"][ablation]["kernel"] is None


def test_rolls_reach_the_ablations_and_an_ablation_has_settings_of_its_own() -> None:
    words = ["study=robustness", "rigid=[multistart,multistart_no_slide]", "rigid.multistart.starts.rolls=24"]
    ((config, _),) = compose_sweep(words)
    assert {name: one["starts"]["rolls"] for name, one in config["rigid"].items()} == {
        "multistart": 24,
        "multistart_no_slide": 24,
    }
    ((config, _),) = compose_sweep([*words, "rigid.multistart_no_slide.starts.rolls=6"])
    assert config["rigid"]["multistart"]["starts"]["rolls"] == 24
    assert config["rigid"]["multistart_no_slide"]["starts"]["rolls"] == 6


def test_an_ablation_alone_is_as_the_file_of_multistart() -> None:
    ((config, _),) = compose_sweep(["study=robustness", "rigid=multistart_no_slide"])
    ((whole, _),) = compose_sweep(["study=robustness", "rigid=multistart"])
    assert list(config["rigid"]) == ["multistart_no_slide"]
    assert leaves(config["rigid"]["multistart_no_slide"]) == leaves(whole["rigid"]["multistart"]) | {
        "starts.slide": False
    }
    with pytest.raises(InputError, match=r"rigid\.multistart\.starts"):
        compose_sweep(["study=robustness", "rigid=multistart_no_slide", "rigid.multistart.starts.rolls=24"])
