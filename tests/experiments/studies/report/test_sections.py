"""Which runs a report shows, and what is left out of them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from run_families import alone, job, segmented, sweep

from experiments.errors import InputError
from experiments.outcome import JobResult
from experiments.studies.report.sections import Source, chosen, section_of, whole_seeds
from experiments.tracking import Store
from experiments.tracking.archive import write_archive

OFF = Store(enabled=False)
STUDIES = ("segmentation", "accuracy", "consistency")


def config(dataset: str, command: str = "ctus study=segmentation") -> dict[str, object]:
    return {
        "dataset": {"_target_": f"x.{dataset}"},
        "call": {"options": {"dataset": dataset}, "command": command},
    }


def test_the_newest_complete_run_of_each_data_set_and_preset_is_chosen(tmp_path: Path) -> None:
    runs = [
        dataclasses.replace(job(name, None, config(dataset, command), status=status), start_ms=start)
        for name, dataset, command, status, start in (
            ("old", "carotid", "ctus", "FINISHED", 1),
            ("new", "carotid", "ctus", "FINISHED", 2),
            ("failed", "carotid", "ctus", "FAILED", 3),
            ("preset", "carotid", "ctus +preset=a", "FINISHED", 1),
            ("first_preset", "carotid", "ctus +sweep=a", "FINISHED", 0),
            ("other", "usgra", "ctus", "FINISHED", 1),
        )
    ]
    elsewhere = job("accurate", None, {"phantoms": ["artery"]}, experiment="accuracy")
    # Phantoms are compared within one section; a configuration that its study cannot read stops nothing.
    repeats = {"phantoms": ["artery"], "sweeps": 2, "masks": "exact"}
    known = dataclasses.replace(job("repeated", None, repeats, experiment="consistency"), start_ms=2)
    earlier = job("earlier", None, {"phantom": "vein"}, experiment="consistency")
    write_archive([*runs, elsewhere, known, earlier], tmp_path)
    found = chosen(Source(OFF, tmp_path), STUDIES, ())
    assert [family.run.run_id for family in found] == ["new", "preset", "other", "accurate", "repeated"]
    named = chosen(Source(OFF, tmp_path), STUDIES, ("old", "ol"))
    assert [family.run.run_id for family in named] == ["old"]
    with pytest.raises(InputError, match="found none that begins with 'gone'"):
        chosen(Source(OFF, tmp_path), STUDIES, ("gone",))


def fold(number: int, seed: int = 0, folds: int = 3) -> JobResult:
    return JobResult(
        {"seed": seed, "fold": number, "split": {"folds": folds}, "out": f"o{number}"}, {}, None, Path()
    )


def test_folds_of_a_training_that_lacks_others_are_left_out() -> None:
    whole = [fold(number) for number in range(3)]
    kept, complete = whole_seeds([*whole, fold(0, seed=1)])
    assert kept == whole and complete
    kept, complete = whole_seeds([fold(0), fold(1)])
    assert len(kept) == 2 and not complete
    plain = [JobResult({"phantoms": ["vein"]}, {}, None, Path())]
    assert whole_seeds(plain) == (plain, True)


def test_a_section_has_what_the_study_makes_of_the_finished_jobs() -> None:
    family = sweep(
        "top",
        [
            job("a", segmented([0.8, 0.9, 0.7], "unet"), config("carotid"), parent="top"),
            job("b", segmented([0.5, 0.6, 0.4], "basic"), config("carotid"), parent="top"),
            job("c", None, config("carotid"), parent="top", status="FAILED"),
        ],
    )
    section = section_of(family)
    assert (section.study, section.subject, section.left_out, section.failure) == (
        "segmentation",
        "carotid",
        1,
        "",
    )
    assert section.title == "segmentation: carotid"
    table = section.outcome.tables["segmentation"]
    assert table["model"].tolist() == ["unet", "basic"]
    assert [one.name for one in section.measured] == ["complexity"]


def test_runs_of_another_version_are_told_and_stop_nothing() -> None:
    broken = section_of(alone("old", segmented([0.5]).drop(columns="group"), config("usgra")))
    assert "expected a column 'group'" in broken.failure and not broken.outcome.tables
    with pytest.raises(InputError, match="expected a run with a job that finished"):
        section_of(alone("none", None, config("usgra"), status="FAILED"))


def test_a_study_that_sums_nothing_up_has_its_metrics() -> None:
    section = section_of(alone("one", None, {"study": "pipeline"}, {"tre_mm": 1.5}, experiment="pipeline"))
    assert section.outcome.tables["metrics"]["tre_mm"].tolist() == [1.5]
