"""The page of the segmentation studies, letter by letter from made-up runs and a made-up summary of them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
import yaml

from experiments.analysis.pages import segmentation
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome
from experiments.studies import segmentation as segmentation_study
from experiments.studies.domain_transfer import study as domain_transfer
from experiments.tracking.archive import write_archive
from experiments.tracking.run_record import RunRecord

PAGE = """# Segmentation of USGRA's vessels

204 in-vivo images of five body regions (tmkand/usgra-seg, CC BY 4.0), 128x128, about 2 M parameters, 3 folds by groups
of near-identical images, 30 epochs. Out-of-fold scores at native resolution; no pixel spacing is known, so distances
are in pixels.
Written by `python scripts/segmentation_results.py usgra` from the runs in `results/runs`.

## Networks

```
ctus -m study=segmentation dataset=usgra dataset.root=<folder> trainer=cpu \
model=unet,basic_unet,attention_unet,unet3plus
```

Commit 0123456789ab; 2 runs; one machine.

### scores

| fold | dsc | cases |
| --- | --- | --- |
| 1 | 0.800 | 2 |
| 0 | 0.900 | 2 |

- Both folds finished.
"""


CONFIG = {
    "dataset": {"_target_": "experiments.datasets.usgra.Usgra"},
    "split": {"folds": 2},
    "trainer": {"accelerator": "cpu", "late_weights": "none"},
    "init": {"_target_": "models.training.initialisation.SharedRandom"},
}
EMA = {
    "trainer": {"accelerator": "cpu", "late_weights": "ema"},
    "init": {"_target_": "models.training.initialisation.Pretrained"},
}


def run(
    run_id: str,
    fold: int,
    dsc: float,
    start_ms: int,
    kind: str = "job",
    status: str = "FINISHED",
    **changes: object,
) -> RunRecord:
    history = pd.DataFrame(
        [("dsc", 0, 0.1, 111), ("dsc", 1, dsc, 222)], columns=["metric", "step", "value", "timestamp_ms"]
    )
    tags = {"ctus.kind": kind, "mlflow.source.git.commit": "0123456789abcdef", "ctus.machine": "one machine"}
    cases = pd.DataFrame({"case_id": ["a", "b"], "dsc": [dsc, dsc]})
    config = yaml.safe_dump({**CONFIG, "fold": fold, "seed": 0, **changes})
    return RunRecord(
        run_id, "segmentation", f"fold {fold}", status, start_ms, start_ms + 1, None, tags, {}, config,
        history, cases,
    )  # fmt: skip


ONLY_CPU = {"usgra": segmentation.SECTIONS["usgra"][:1]}


def summarise(results: list[JobResult]) -> Outcome:
    rows = [
        {"fold": result.config["fold"], "dsc": result.metrics["dsc"], "cases": len(result.cases)}
        for result in results
        if result.cases is not None
    ]
    return Outcome(tables={"scores": pd.DataFrame(rows)}, findings=("Both folds finished.",))


def test_page_of_the_finished_jobs_in_the_order_they_began(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(segmentation, "SECTIONS", ONLY_CPU)
    gpu = {"trainer": {"accelerator": "gpu"}}
    other = {"dataset": {"_target_": "experiments.datasets.carotid.Carotid"}}
    runs = [run("a", 0, 0.9, 2000), run("b", 1, 0.8, 1000), run("c", 2, 0.7, 3000, status="FAILED"),
            run("d", 3, 0.6, 500, kind="sweep"), run("e", 0, 0.5, 4000, **gpu),
            run("f", 0, 0.4, 5000, **other)]  # fmt: skip
    write_archive(runs, tmp_path / "runs")
    segmentation.write_page(tmp_path / "runs", tmp_path / "page.md", "usgra", {"segmentation": summarise})
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == PAGE


def test_recipes_are_told_apart_and_seeds_that_lack_folds_left_out(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(segmentation, "SECTIONS", ONLY_CPU)
    runs = [run("a", 0, 0.9, 1000), run("b", 1, 0.8, 2000), run("c", 0, 0.7, 3000, seed=1),
            run("d", 0, 0.6, 4000, **EMA), run("e", 1, 0.5, 5000, **EMA)]  # fmt: skip
    write_archive(runs, tmp_path / "runs")
    seen: list[dict[str, str]] = []

    def summary(results: list[JobResult]) -> Outcome:
        seen.extend(dict(result.choices) for result in results)
        return Outcome()

    segmentation.write_page(tmp_path / "runs", tmp_path / "page.md", "usgra", {"segmentation": summary})
    assert seen == [{"recipe": "default"}] * 2 + [{"init": "pretrained", "late_weights": "ema"}] * 2
    assert "4 runs; one machine. Runs of seeds that lack folds, left out: 1." in (
        tmp_path / "page.md"
    ).read_text(encoding="utf-8")


def test_a_section_without_finished_runs_and_an_unknown_data_set_are_refused(tmp_path: Path) -> None:
    write_archive([run("a", 0, 0.9, 2000), run("b", 1, 0.9, 2000)], tmp_path / "runs")
    page = tmp_path / "page.md"
    with pytest.raises(InputError, match=r"segmentation on usgra by trainer\.accelerator=gpu, found none"):
        segmentation.write_page(tmp_path / "runs", page, "usgra", {"segmentation": summarise})
    with pytest.raises(InputError, match="dataset: expected one of carotid, usgra, received aorta"):
        segmentation.write_page(tmp_path / "runs", page, "aorta", {"segmentation": summarise})
    assert not page.exists()


@pytest.mark.parametrize("name", sorted(segmentation.SECTIONS))
def test_the_page_in_the_repository_is_what_its_runs_give(
    repository: Path, tmp_path: Path, name: str
) -> None:
    both = {"segmentation": segmentation_study.summarise, "domain_transfer": domain_transfer.summarise}
    segmentation.write_page(repository / "results" / "runs", tmp_path / "page.md", name, both)
    kept = repository / "results" / f"segmentation_{name}.md"
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == kept.read_text(encoding="utf-8")
