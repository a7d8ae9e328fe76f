"""The page of the consolidation study, from made-up runs and a made-up summary of them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure

from experiments.analysis.pages import consolidation
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome
from experiments.tracking.archive import write_archive
from experiments.tracking.run_record import RunRecord

CONFIG = """training_seed: {seed}
trainer: {{max_epochs: 15, batch_size: 4}}
split: {{folds: 3, outer_folds: null}}
image_size_px: 128
init: {{_target_: models.training.initialisation.Pretrained}}
"""


def run(
    run_id: str, seed: int, start_ms: int, *, dataset: str = "usgra", simulated: str = "false"
) -> RunRecord:
    history = pd.DataFrame([("dsc_mean", 0, 0.7, 1)], columns=["metric", "step", "value", "timestamp_ms"])
    tags = {"ctus.kind": "job", "mlflow.source.git.commit": "0123456789abcdef", "ctus.machine": "one machine"}
    tags |= {"dataset": dataset, "simulated": simulated}
    cases = pd.DataFrame({"kind": ["case"], "case_id": ["a"], "dsc": [0.5]})
    return RunRecord(
        run_id, "consolidation", f"seed {seed}", "FINISHED", start_ms, start_ms + 1, None, tags, {},
        CONFIG.format(seed=seed), history, cases,
    )  # fmt: skip


def summarise(results: list[JobResult]) -> Outcome:
    seeds = [result.config["training_seed"] for result in results]
    return Outcome(
        tables={"candidates": pd.DataFrame({"model": ["uniform"], "seeds": [len(seeds)]})},
        figures={"barriers": Figure()},
        findings=("The average passes.",),
        files={"certificate.md": lambda path: path.write_text("# Certificate\n", encoding="utf-8") and None},
    )


def test_the_page_holds_findings_tables_figures_and_the_certificate(tmp_path: Path) -> None:
    runs = [
        run("a", 1, 2000),
        run("b", 0, 1000),
        run("c", 0, 500, dataset="carotid"),
        run("d", 0, 1, simulated="true"),
    ]
    write_archive(runs, tmp_path / "runs")
    out = tmp_path / "results"
    out.mkdir()
    assert consolidation.write_page(tmp_path / "runs", out, "usgra", summarise) == 2
    page = (out / "consolidation_usgra.md").read_text(encoding="utf-8")
    assert page.startswith("# One model from the folds: usgra\n")
    assert "Commit 0123456789ab; 2 runs\n(seeds 0, 1); one machine." in page
    assert "Trainings: 3 folds, at most 15 epochs of batches of 4, 128 px, from pretrained weights." in page
    assert "- The average passes.\n" in page and "| uniform | 2 |" in page
    assert "## Candidates on test groups\n\n| model | seeds |" in page
    for name in ("consolidation_usgra_barriers.png", "consolidation_usgra_certificate.md"):
        assert f"({name})" in page and (out / name).is_file()
    assert (out / "consolidation_usgra_candidates.csv").read_text(
        encoding="utf-8"
    ) == "model,seeds\nuniform,2\n"


def test_simulated_runs_have_a_page_of_their_own(tmp_path: Path) -> None:
    write_archive([run("a", 0, 1), run("d", 3, 1, simulated="true")], tmp_path / "runs")
    assert consolidation.write_page(tmp_path / "runs", tmp_path, "simulated", summarise) == 1
    assert "(seeds 3)" in (tmp_path / "consolidation_simulated.md").read_text(encoding="utf-8")
    with pytest.raises(InputError, match="expected finished runs of consolidation on carotid, found none"):
        consolidation.write_page(tmp_path / "runs", tmp_path, "carotid", summarise)
