"""Two tracked runs side by side: settings, metrics, tests, a figure, and sentences that claim what was shown."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
from run_families import alone, job, segmented, sweep, trials

from experiments.cli import main
from experiments.errors import InputError
from experiments.outcome import Outcome
from experiments.studies.compare import study
from experiments.tracking import Store
from experiments.tracking.archive import write_archive
from experiments.tracking.run_lookup import Family


def compared(folder: Path, first: Family, second: Family) -> Outcome:
    records = [record for family in (first, second) for record in (family.run, *family.below)]
    write_archive(records, folder)
    ids = [family.run.run_id for family in (first, second)]
    return study.run(runs=ids, archive=str(folder), unit=None, store=Store(enabled=False))


def test_two_networks_are_compared_by_settings_metrics_and_tests(tmp_path: Path) -> None:
    second = [0.4 + number / 50 for number in range(8)]
    first = alone(
        "aaaaaaaaaa",
        segmented([value + 0.1 for value in second], "unet"),
        {"model": {"width": 16, "dropout": 0.1}, "out": "x", "dataset": {"cache": "x"}},
        {"dsc_mean": 0.57, "training_s": 3.0, "epochs": 4.0},
    )
    other = alone(
        "bbbbbbbbbb",
        segmented(second, "attention_unet"),
        {"model": {"width": 8, "dropout": 0.1}, "out": "y", "dataset": {"cache": "y"}},
        {"dsc_mean": 0.47, "training_s": 9.0, "epochs": 4.0},
        tags={"ctus.machine": "another"},
    )
    found = compared(tmp_path, first, other)
    names = ["unet aaaaaaaa", "attention_unet bbbbbbbb"]
    assert found.tables["settings that differ"].to_numpy().tolist() == [
        ["model.width", "16", "8"],
        ["machine", "m", "another"],
    ]
    metrics = found.tables["metrics that differ"]
    assert list(metrics) == ["metric", *names, "difference"]
    assert metrics["metric"].tolist() == ["dsc_mean"]
    assert metrics["difference"].tolist() == pytest.approx([0.1])
    assert found.tables["paired tests"]["verdict"].tolist() == ["unet aaaaaaaa better"] * 2
    assert found.metrics["dsc_p"] == pytest.approx(2 / 2**8)
    said = " ".join(found.findings)
    assert "Compared on 8 cases that both have; the unit is the group, of which there are 8." in said
    assert "least attainable p 0.008" in said
    assert "The contents of the data are not recorded for both runs" in said
    found.files["comparison.json"](tmp_path / "comparison.json")
    content = json.loads((tmp_path / "comparison.json").read_text())
    assert (content["first"], content["cases"], len(content["tests"])) == ("aaaaaaaaaa", 8, 2)
    assert len(found.figures["paired_differences"].axes) == 2


def test_few_units_claim_nothing(tmp_path: Path) -> None:
    found = compared(tmp_path, alone("aa", segmented([0.9] * 3)), alone("bb", segmented([0.1, 0.2, 0.3])))
    said = " ".join(found.findings)
    assert "better" not in said
    assert (
        "So few units can show no difference at 0.05: the least p that any of these 2 tests can give is 0.500"
        in said
    )


def test_methods_of_registration_are_compared_with_failures_ranked_worst(tmp_path: Path) -> None:
    first = trials({f"a{number}": [1.0, 1.5] for number in range(7)}, "multistart")
    second = trials({f"a{number}": [float("inf"), 4.0] for number in range(7)})
    found = compared(
        tmp_path, alone("aa", first, experiment="robustness"), alone("bb", second, experiment="robustness")
    )
    table = found.tables["paired tests"]
    assert table["metric"].tolist() == ["success_tre", "tre_mm", "success", "rmse_mm"]
    assert "exact signed-rank test" in " ".join(found.findings)
    titles = [axes.get_title() for axes in found.figures["paired_differences"].axes]
    assert "7 at the edge: one run failed" in titles[1]


def test_a_single_anatomy_says_nothing_of_others(tmp_path: Path) -> None:
    found = compared(
        tmp_path, alone("aa", trials({"a": [1.0, 1.0]}, "multistart")), alone("bb", trials({"a": [9.0, 1.0]}))
    )
    assert any("with a single anatomy nothing can be said of others" in text for text in found.findings)


def test_settings_of_sweeps_have_all_their_values(tmp_path: Path) -> None:
    jobs = [
        job(f"a{seed}", segmented([0.5] * 3, seed=seed), {"seed": seed, "model": {"width": 8}}, parent="aa")
        for seed in (0, 1)
    ]
    other = [job("b0", segmented([0.6] * 3, seed=0), {"seed": 0, "model": {"width": 16}}, parent="bb")]
    found = compared(tmp_path, sweep("aa", jobs), sweep("bb", other))
    assert found.tables["settings that differ"].to_numpy().tolist() == [
        ["model.width", "8", "16"],
        ["seed", "0 | 1", "0"],
    ]
    assert any("only 0 count, which both have" in text for text in found.findings)


def test_what_can_not_be_compared_is_refused(tmp_path: Path) -> None:
    one, other = alone("aa", segmented([0.5])), alone("bb", trials({"a": [1.0]}), experiment="robustness")
    with pytest.raises(
        InputError, match="two of one study, received one of segmentation and one of robustness"
    ):
        compared(tmp_path, one, other)
    with pytest.raises(InputError, match="expected two runs, received aa twice"):
        compared(tmp_path, one, one)
    with pytest.raises(InputError, match=r"expected two ids, runs=\[first,second\]"):
        study.run(runs=["aa"], archive=str(tmp_path), unit=None, store=Store(enabled=False))


def test_two_runs_of_the_store_are_compared_from_the_command_line(
    counting_study: ModuleType, home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    counting_study.run = _scoring(counting_study.run)
    assert main(["study=counting", "parts=[1]", "seed=1"]) == 0
    assert main(["study=counting", "parts=[1]", "seed=2"]) == 0
    ids = [run.info.run_id for run in Store().runs()]
    capsys.readouterr()
    assert main(["study=compare", f"runs=[{ids[1][:12]},{ids[0][:12]}]", f"out={home / 'compared'}"]) == 0
    said = capsys.readouterr().out
    assert "Compared on 3 cases that both have" in said
    assert (home / "compared" / "paired_differences.png").is_file()
    assert pd.read_csv(home / "compared" / "settings.csv")["setting"].tolist() == ["seed"]


def _scoring(run: object) -> object:
    """The counting study with cases that have a DSC, of frames that are the same for every seed."""
    import dataclasses
    import inspect

    def scored(**settings: object) -> Outcome:
        found = run(**settings)  # type: ignore[operator]
        return dataclasses.replace(found, cases=segmented([0.5, 0.6, 0.7], seed=int(str(settings["seed"]))))

    scored.__signature__ = inspect.signature(run)  # type: ignore[attr-defined, arg-type]
    return scored
