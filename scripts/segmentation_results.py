"""Write results/segmentation_usgra.md from the runs under results/runs: no training is repeated for it.

Usage: python scripts/segmentation_results.py [ARCHIVE] [OUT]. The runs come from the commands that the page names,
followed by ctus study=export_runs "experiments=[segmentation,domain_transfer]".
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import yaml

from experiments import files
from experiments.outcome import JobResult, Outcome
from experiments.running.terminal import markdown
from experiments.studies import segmentation
from experiments.studies.domain_transfer import study as domain_transfer
from experiments.tracking.archive import read_archive
from experiments.tracking.run_record import RunRecord

HEAD = """# Segmentation of USGRA's vessels

204 in-vivo images of five body regions (tmkand/usgra-seg, CC BY 4.0), 128x128, about 2 M parameters, 3 folds by groups
of near-identical images, 30 epochs, on two CPU cores. Out-of-fold scores at native resolution; no pixel spacing is
known, so distances are in pixels. Written by `python scripts/segmentation_results.py` from the runs in `results/runs`.

"""
COMMANDS = {
    "segmentation": (
        "ctus -m study=segmentation dataset=usgra dataset.root=<folder> trainer=cpu "
        "model=unet,basic_unet,attention_unet,unet3plus"
    ),
    "domain_transfer": (
        "ctus study=domain_transfer dataset@first=phantom dataset@second=usgra second.root=<folder> trainer=cpu"
    ),
}
TITLES = {"segmentation": "Networks", "domain_transfer": "Simulator to USGRA and back"}
STUDIES = {"segmentation": segmentation, "domain_transfer": domain_transfer}


def main() -> int:
    """Write the page; 2 if there are no such runs."""
    given = [Path(word) for word in sys.argv[1:]]
    archive, out = (*given, *[Path("results/runs"), Path("results/segmentation_usgra.md")][len(given) :])
    parts = [HEAD]
    for study, module in STUDIES.items():
        runs = sorted(_jobs(archive, study), key=lambda run: run.start_ms)
        if not runs:
            print(f"{archive}: expected finished runs of {study}, found none", file=sys.stderr)
            return 2
        parts.append(_section(study, module.summarise([_result(run) for run in runs]), runs))
    files.write_text(out, "\n".join(parts).strip() + "\n")
    print(f"{out}")
    return 0


def _jobs(archive: Path, study: str) -> Iterator[RunRecord]:
    for run in read_archive(archive, [study]):
        if run.tags.get("ctus.kind") == "job" and run.status == "FINISHED":
            yield run


def _result(run: RunRecord) -> JobResult:
    last = run.history.sort_values("step").groupby("metric")["value"].last()
    metrics = {str(name): float(value) for name, value in last.items()}
    return JobResult(yaml.safe_load(run.config), metrics, run.cases, Path(run.name), run.run_id)


def _section(study: str, outcome: Outcome, runs: list[RunRecord]) -> str:
    commits = sorted({run.tags.get("mlflow.source.git.commit", "unknown")[:12] for run in runs})
    machines = sorted({run.tags.get("ctus.machine", "unknown") for run in runs})
    said = "\n".join(f"- {finding}" for finding in outcome.findings)
    return (
        f"## {TITLES[study]}\n\n```\n{COMMANDS[study]}\n```\n\nCommit {', '.join(commits)}; {len(runs)} runs; "
        f"{', '.join(machines)}.\n\n{markdown(dict(outcome.tables))}\n{said}\n"
    )


if __name__ == "__main__":
    sys.exit(main())
