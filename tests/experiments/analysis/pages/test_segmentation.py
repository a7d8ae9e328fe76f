"""The page of the segmentation studies, letter by letter from made-up runs and a made-up summary of them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from experiments.analysis.pages import segmentation
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome
from experiments.studies import segmentation as segmentation_study
from experiments.studies.domain_transfer import study as domain_transfer
from experiments.tracking.archive import write_archive
from experiments.tracking.run_record import RunRecord

PAGE = """# Segmentation of USGRA's vessels

204 in-vivo images of five body regions (tmkand/usgra-seg, CC BY 4.0), 128x128, about 2 M parameters, 3 folds by groups
of near-identical images, 30 epochs, on two CPU cores. Out-of-fold scores at native resolution; no pixel spacing is
known, so distances are in pixels. Written by `python scripts/segmentation_results.py` from the runs in `results/runs`.


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


def run(
    run_id: str, fold: int, dsc: float, start_ms: int, kind: str = "job", status: str = "FINISHED"
) -> RunRecord:
    history = pd.DataFrame(
        [("dsc", 0, 0.1, 111), ("dsc", 1, dsc, 222)], columns=["metric", "step", "value", "timestamp_ms"]
    )
    tags = {"ctus.kind": kind, "mlflow.source.git.commit": "0123456789abcdef", "ctus.machine": "one machine"}
    cases = pd.DataFrame({"case_id": ["a", "b"], "dsc": [dsc, dsc]})
    return RunRecord(
        run_id, "segmentation", f"fold {fold}", status, start_ms, start_ms + 1, None, tags, {}, f"fold: {fold}\n",
        history, cases,
    )  # fmt: skip


def summarise(results: list[JobResult]) -> Outcome:
    rows = [
        {"fold": result.config["fold"], "dsc": result.metrics["dsc"], "cases": len(result.cases)}
        for result in results
        if result.cases is not None
    ]
    return Outcome(tables={"scores": pd.DataFrame(rows)}, findings=("Both folds finished.",))


def test_page_of_the_finished_jobs_in_the_order_they_began(tmp_path: Path) -> None:
    runs = [run("a", 0, 0.9, 2000), run("b", 1, 0.8, 1000), run("c", 2, 0.7, 3000, status="FAILED"),
            run("d", 3, 0.6, 500, kind="sweep")]  # fmt: skip
    write_archive(runs, tmp_path / "runs")
    segmentation.write_page(tmp_path / "runs", tmp_path / "page.md", {"segmentation": summarise})
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == PAGE


def test_a_study_without_finished_runs_is_refused(tmp_path: Path) -> None:
    write_archive([run("a", 0, 0.9, 2000)], tmp_path / "runs")
    with pytest.raises(InputError, match="expected finished runs of domain_transfer, found none"):
        segmentation.write_page(tmp_path / "runs", tmp_path / "page.md", {"domain_transfer": summarise})
    assert not (tmp_path / "page.md").exists()


def test_the_page_in_the_repository_is_what_its_runs_give(repository: Path, tmp_path: Path) -> None:
    both = {"segmentation": segmentation_study.summarise, "domain_transfer": domain_transfer.summarise}
    segmentation.write_page(repository / "results" / "runs", tmp_path / "page.md", both)
    kept = repository / "results" / "segmentation_usgra.md"
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == kept.read_text(encoding="utf-8")
