"""Names that say what was run on what, and a dozen settings as columns."""

from __future__ import annotations

import pytest

from experiments.cli import compose_sweep
from experiments.running import run_names
from experiments.running.job_names import choices_of
from experiments.running.jobs import Job, job_configs
from experiments.running.variants import variants_of


def jobs_of(*words: str, multirun: bool = False) -> list[Job]:
    found: list[Job] = []
    for config, label in compose_sweep(list(words), multirun=multirun):
        for job, change in job_configs(config):
            both = ",".join(filter(None, (label, change)))
            found.append(Job(job, str(len(found)), both, choices_of(label)))
    return found


def test_networks_on_a_data_set_with_their_folds() -> None:
    jobs = jobs_of("study=segmentation", "model=unet,attention_unet", "trainer=smoke", multirun=True)
    assert run_names.sweep_name(jobs) == "phantom: unet, attention_unet"
    assert [(variant.name, len(variant.jobs)) for variant in variants_of(jobs)] == [
        ("unet", 3),
        ("attention_unet", 3),
    ]
    assert run_names.job_name(jobs[0], with_subject=False) == "fold 0 of unet"
    assert run_names.job_name(jobs[0], with_subject=True) == "fold 0 of phantom, unet"
    expected = {"model": "unet", "dataset": "phantom", "budget": "smoke", "fold": "0", "seed": "0"}
    found = run_names.parameters(jobs[0])
    assert found.items() >= expected.items() and len(found) <= run_names.MOST_PARAMETERS


def test_a_swept_option_is_named_and_has_a_column_even_where_it_is_the_default() -> None:
    words = ("study=segmentation", "augmentation=default,strong", "seed=0,1", "fold=0")
    jobs = jobs_of(*words, multirun=True)
    assert run_names.sweep_name(jobs) == "phantom: unet by augmentation"
    assert [variant.name for variant in variants_of(jobs)] == [
        "unet, augmentation default",
        "unet, augmentation strong",
    ]
    assert {run_names.parameters(job)["augmentation"] for job in jobs} == {"default", "strong"}


def test_what_the_command_line_set_is_a_column() -> None:
    (job,) = jobs_of("study=segmentation", "fold=0", "trainer.max_epochs=3", "out=somewhere")
    found = run_names.parameters(job)
    assert found["max_epochs"] == "3" and "out" not in found and "study" not in found


def test_methods_on_pieces_of_a_vessel() -> None:
    words = ("study=robustness", "target=/data/aorta.stl", "rigid=[single_icp,multistart]", "trials=5")
    jobs = jobs_of(*words, "perturbation.noise_mm=0.5")
    assert run_names.sweep_name(jobs) == "aorta.stl: single_icp, multistart by overlap"
    assert [variant.name for variant in variants_of(jobs)] == [
        "single_icp, overlap 1.0",
        "multistart, overlap 1.0",
        "single_icp, overlap 0.6, place middle",
        "multistart, overlap 0.6, place middle",
    ]
    expected = {"rigid": "single_icp", "target": "aorta.stl", "overlap": "1.0", "noise_mm": "0.5"}
    expected |= {"trials": "5", "seed": "0", "rotation": "any", "translation_mm": "10.0"}
    found = run_names.parameters(jobs[0])
    assert found.items() >= expected.items() and "place" not in found


def test_levels_of_a_factor_stand_in_their_column() -> None:
    jobs = jobs_of(
        "study=robustness", "target=a.stl", "rigid=[single_icp]", "overlaps=[1.0]", "+factors.noise_mm=[0,1]"
    )
    assert [run_names.parameters(job)["noise_mm"] for job in jobs] == ["0.0", "0, 1"]
    assert [variant.name for variant in variants_of(jobs)][1] == "single_icp, overlap 1.0, factor noise_mm"


def test_a_registration_is_called_after_its_files_and_methods() -> None:
    files = ("study=register", "moving=/a/surface.ply", "fixed=/b/aorta.stl")
    (job,) = jobs_of(*files)
    assert run_names.job_name(job, with_subject=True) == "surface.ply to aorta.stl, multistart"
    jobs = jobs_of(*files, "deformable=none,cpd", multirun=True)
    assert run_names.sweep_name(jobs) == "surface.ply to aorta.stl: multistart, multistart + cpd"


def test_phantoms_and_data_sets_are_told_apart() -> None:
    jobs = jobs_of("study=consistency")
    assert run_names.sweep_name(jobs) == "artificial, vein, artery"
    assert [run_names.job_name(job, with_subject=True) for job in jobs] == ["artificial", "vein", "artery"]
    assert [run_names.parameters(job)["phantom"] for job in jobs] == ["artificial", "vein", "artery"]
    jobs = jobs_of("study=domain_transfer")
    assert [variant.name for variant in variants_of(jobs)] == [
        "unet, trained on phantom",
        "unet, trained on usgra",
    ]
    assert run_names.parameters(jobs[-1]).items() >= {"dataset": "usgra", "other_dataset": "phantom"}.items()


def test_a_configuration_that_no_command_line_made_is_named_by_its_classes() -> None:
    (job,) = jobs_of("study=segmentation", "fold=0")
    config = {key: value for key, value in job.config.items() if key != "call"}
    assert run_names.thing(Job(config, "0", "")) == "UNet"


def test_main_parameters_are_what_is_compared_on_what() -> None:
    words = ("study=robustness", "target=/data/aorta.stl", "rigid=[single_icp,multistart]")
    assert run_names.main_parameters(jobs_of(*words)) == ["rigid", "target", "overlap", "place"]
    jobs = jobs_of("study=segmentation", "model=unet,unet3plus", "seed=0,1", multirun=True)
    assert run_names.main_parameters(jobs) == ["model", "dataset"]


def test_shared_parameters_leave_out_what_differs_or_list_it() -> None:
    each = [
        {"model": "unet", "fold": "0", "split": "folds"},
        {"model": "unet3plus", "fold": "1", "split": "folds"},
    ]
    assert run_names.shared_parameters(each, listed=False) == {"split": "folds"}
    assert run_names.shared_parameters(each, listed=True) == {"model": "unet, unet3plus", "split": "folds"}
    # what some lack is no setting of all
    assert run_names.shared_parameters([{"place": "end"}, {}], listed=False) == {}


@pytest.mark.parametrize("study", ["segmentation", "robustness", "register", "consistency"])
def test_what_a_study_shows_is_little(study: str) -> None:
    from experiments.running.jobs import study_module

    assert 8 <= len(study_module(study).HEADLINE) <= 13
