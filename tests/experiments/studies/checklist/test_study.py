"""Checklists filled from runs: every item there, what runs tell filled in, and nothing guessed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from run_families import alone, job, segmented, sweep, trials

from experiments.errors import InputError
from experiments.studies.checklist import study
from experiments.studies.checklist.claim import claim, leakage
from experiments.studies.checklist.claim_items import ITEMS
from experiments.studies.checklist.facts import Facts, rate_with_interval
from experiments.studies.checklist.items import FILLED, IN_PART, MISSING, state
from experiments.studies.checklist.registration import registration_accuracy
from experiments.tracking import Store
from experiments.tracking.archive import write_archive
from experiments.tracking.run_lookup import Family

CONFIG: dict[str, Any] = {
    "dataset": {"_target_": "experiments.datasets.usgra.Usgra", "root": ".../usgra", "unpaired": "refuse"},
    "model": {"_target_": "models.networks.unet.UNet", "width": 16},
    "trainer": {"selection": "best", "patience": 15},
    "split": {"folds": 2},
}


def networks() -> Family:
    jobs = [
        job(
            f"j{fold}{seed}",
            segmented([0.9, 0.8, 0.0], seed=seed, fold=fold, first=3 * fold),
            {**CONFIG, "seed": seed},
            parent="top",
        )
        for fold in (0, 1)
        for seed in (0, 1)
    ]
    return sweep("top", jobs)


def registrations() -> Family:
    cases = trials({"a": [1.0, 1.5, float("inf")], "b": [0.5, 3.0, 1.0]}, "multistart")
    config = {"perturbation": {"angle_max_deg": 180.0}, "rigid": {"multistart": {"rolls": 8}}}
    return alone(
        "reg", cases, config, experiment="robustness", tags={"tre_targets": "points", "tre_targets_n": "500"}
    )


def told(family: Family, number: str) -> str:
    checklist = registration_accuracy() if number.startswith("R") else claim()
    filled = {item.number: filling for item, filling in checklist.filled(Facts((family,)))}
    return "\n".join(filled[number].told)


def test_the_items_are_those_of_the_2024_update_in_order() -> None:
    assert [item.number for item in ITEMS] == [str(number) for number in range(1, 45)]
    assert set(claim().fillers) <= {item.number for item in ITEMS}
    by_number = {item.number: item.asks for item in ITEMS}
    assert "external" in by_number["33"]
    assert "share nothing" in by_number["20"]
    assert "Funding" in by_number["44"]


def test_what_no_run_can_tell_stays_missing() -> None:
    filled = claim().filled(Facts((networks(),)))
    states = {item.number: state(filling) for item, filling in filled}
    # Title apart, what concerns people, purpose and money.
    assert {
        states[number] for number in ("2", "3", "4", "5", "6", "11", "15", "16", "17", "18", "31", "34")
    } == {MISSING}
    assert {states[number] for number in ("36", "40", "41", "44", "33", "13", "14")} == {MISSING}
    assert {states[number] for number in ("19", "22", "23", "25", "26", "28", "32", "37")} == {FILLED}
    assert {states[number] for number in ("1", "7", "20", "35", "39", "42", "43")} == {IN_PART}


def test_settings_versions_and_numbers_come_from_the_runs() -> None:
    family = networks()
    assert "UNet(width=16)" in told(family, "22")
    absolute = {**CONFIG, "dataset": {**CONFIG["dataset"], "root": "/srv/data/usgra"}}
    # A checklist is for others: it names no folder of a machine.
    assert "root=.../usgra" in told(alone("one", segmented([0.5]), absolute), "7")
    wider = job("w", segmented([0.5]), {**CONFIG, "model": {**CONFIG["model"], "width": 32}}, parent="top")
    assert "UNet(width=16 | 32)" in told(sweep("top", [*family.below, wider]), "22")
    assert "numpy 2" in told(family, "23")
    assert "code at commit aaaaaaaaaaaa" in told(family, "23")
    assert "seeds: 0, 1" in told(family, "25")
    assert "6 cases of 6 groups" in told(family, "32")
    assert "dsc 0.567 (95 % interval" in told(family, "37")
    assert "n = 6 groups, 12 rows" in told(family, "37")
    assert "missed 4 of 12" in told(family, "38")
    assert "lowest DSC c2 0.00, c5 0.00" in told(family, "39")


def test_a_group_in_two_partitions_is_found_in_the_cases() -> None:
    apart = pd.concat([segmented([0.5, 0.6], fold=0), segmented([0.5], fold=1, first=2)])
    assert "no group is scored in two folds or parts" in leakage(apart)
    both = pd.concat([segmented([0.5, 0.6], fold=0), segmented([0.5], fold=1, first=1)])
    assert "1 groups are in two" in leakage(both)
    set_aside = pd.concat([segmented([0.5]), segmented([0.5]).assign(part="test")])
    assert "1 groups are in two" in leakage(set_aside)
    # Another division may put a group elsewhere, and data that nothing was trained on are scored by all folds.
    again = pd.concat([apart, segmented([0.5, 0.6], fold=1, seed=1)])
    assert "no group is scored in two" in leakage(again)
    other = both.assign(train_dataset="phantom")
    assert "no group is scored in two" in leakage(other)


def test_the_accuracy_of_registration_is_told_with_its_tail_and_failures() -> None:
    family = registrations()
    assert "success_tre: a TRE of at most 2 mm" in told(family, "R4")
    assert "multistart: 6 rows on 2 anatomy(s)" in told(family, "R6")
    assert "tre_mm median 1.25, 95th percentile inf, largest inf" in told(family, "R7")
    assert "success_tre 4 of 6 (0.667); over units" in told(family, "R8")
    assert "2 of 6 over 2 mm, of which 1 without a result" in told(family, "R9")
    assert "lost (1)" in told(family, "R9")
    assert "4 of 6 accepted" in told(family, "R10")
    assert "the pose is known exactly" in told(family, "R12")
    assert told(family, "R14") == ""


def test_a_rate_has_an_interval_over_units_where_rows_share_them() -> None:
    cases = pd.DataFrame({"group": ["a", "b"], "hit": [1.0, 0.0]})
    assert "Wilson 95 % interval 0.0945 to 0.905" in rate_with_interval(cases, "hit", "group")
    single = pd.DataFrame({"group": ["a", "a"], "hit": [1.0, 0.0]})
    assert "of these trials on a single group, not of others" in rate_with_interval(single, "hit", "group")


def test_the_checklists_that_fit_are_written_and_what_is_missing_is_listed(tmp_path: Path) -> None:
    records = [record for family in (networks(), registrations()) for record in (family.run, *family.below)]
    write_archive(records, tmp_path / "archive")
    found = study.run(runs=["top", "reg"], archive=str(tmp_path / "archive"), store=Store(enabled=False))
    assert set(found.files) == {"claim_2024.md", "registration_accuracy.md"}
    assert found.metrics["claim_2024_filled"] + found.metrics["claim_2024_in_part"] < 44
    assert found.findings[0].startswith("CLAIM 2024: ")
    found.files["claim_2024.md"](tmp_path / "claim.md")
    text = (tmp_path / "claim.md").read_text()
    assert "- `top`: segmentation, run top" in text
    assert text.index("## Still to be written") < text.index("- 44: Funding")
    assert "e240300" in text
    alone_found = study.run(runs=["reg"], archive=str(tmp_path / "archive"), store=Store(enabled=False))
    assert set(alone_found.files) == {"registration_accuracy.md"}


def test_runs_that_measure_neither_are_refused(tmp_path: Path) -> None:
    write_archive([job("x", pd.DataFrame({"case_id": ["a"], "value": [1.0]}))], tmp_path)
    with pytest.raises(InputError, match="expected runs with cases that score masks"):
        study.run(runs=["x"], archive=str(tmp_path), store=Store(enabled=False))
    with pytest.raises(InputError, match="expected a list of ids"):
        study.run(runs=[], archive=str(tmp_path), store=Store(enabled=False))
