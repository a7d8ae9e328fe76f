"""Pages of the segmentation studies, one for each data set, from exported runs: no training is repeated for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from experiments import files
from experiments.analysis.pages.page_parts import archived_result, finished_jobs, listed
from experiments.errors import InputError
from experiments.outcome import JobResult, Outcome
from experiments.running.terminal import markdown
from experiments.tracking.names import flatten
from experiments.tracking.run_record import RunRecord

# A run of an archive, and what the summary of its study takes it for.
Job: TypeAlias = tuple[RunRecord, JobResult]

WRITTEN = "Written by `python scripts/segmentation_results.py {name}` from the runs in `results/runs`.\n"
HEADS = {
    "usgra": """# Segmentation of USGRA's vessels

204 in-vivo images of five body regions (tmkand/usgra-seg, CC BY 4.0), 128x128, about 2 M parameters, 3 folds by groups
of near-identical images, 30 epochs. Out-of-fold scores at native resolution; no pixel spacing is known, so distances
are in pixels.
""",
    "carotid": """# Segmentation of carotid arteries, one subject left out

500 images of five subjects, 128x128, about 2 M parameters, 5 folds: each subject is scored by networks that saw the
other four, for 8 epochs. Published for the thesis's networks on its own images: DSC 0.89 to 0.93. Scores at native
resolution; no pixel spacing is known, so distances are in pixels. U-Net 3+, ten times as slow, is not there yet.
""",
}


@dataclass(frozen=True)
class Section:
    """A section of a page: the runs of one study that it is about.

    Parameters
    ----------
    title : str
        Heading.
    study : str
        Name of the study.
    commands : tuple of str
        What made the runs.
    accelerator : str
        ``trainer.accelerator`` of its runs.
    """

    title: str
    study: str
    commands: tuple[str, ...]
    accelerator: str = "cpu"


GPU = "trainer=cpu trainer.accelerator=gpu"
PRETRAINED = (
    f"dataset=usgra dataset.root=<folder> {GPU} init=pretrained init.path=<carotid start>/model.pt seed=0,1,2"
)
SECTIONS = {
    "usgra": (
        Section(
            "Networks",
            "segmentation",
            (
                "ctus -m study=segmentation dataset=usgra dataset.root=<folder> trainer=cpu "
                "model=unet,basic_unet,attention_unet,unet3plus",
            ),
        ),
        Section(
            "Start, late weights and empty frames: the same budget of epochs on a GPU",
            "segmentation",
            (
                f"ctus -m +sweep=empty_frames dataset=usgra dataset.root=<folder> {GPU}",
                "ctus study=pretrain dataset=carotid dataset.root=<folder> trainer=cpu trainer.max_epochs=8 "
                "out=<carotid start>",
                f"ctus -m study=segmentation {PRETRAINED}",
                f"ctus -m study=segmentation {PRETRAINED} trainer.late_weights=ema trainer.selection=last",
            ),
            "gpu",
        ),
        Section(
            "Simulator to USGRA and back",
            "domain_transfer",
            (
                "ctus study=domain_transfer dataset@first=phantom dataset@second=usgra second.root=<folder> "
                "trainer=cpu",
            ),
        ),
    ),
    "carotid": (
        Section(
            "Networks",
            "segmentation",
            (
                f"ctus -m study=segmentation dataset=carotid dataset.root=<folder> {GPU} split.folds=5 "
                "trainer.max_epochs=8 trainer.patience=8 model=unet,attention_unet,unet3plus seed=0,1,2",
            ),
            "gpu",
        ),
    ),
}
# Settings that name a recipe where they are not the default, which is the second; what values are called.
RECIPE = {
    "init._target_": ("init", "shared_random"),
    "trainer.late_weights": ("late_weights", "none"),
    "trainer.selection": ("selection", "best"),
    "trainer.empty_weight": ("empty_weight", "1.0"),
    "model.presence": ("presence", "False"),
}
VALUES = {
    "models.training.initialisation.SharedRandom": "shared_random",
    "models.training.initialisation.Pretrained": "pretrained",
}


def write_page(
    archive: Path, out: Path, name: str, summarise: Mapping[str, Callable[[list[JobResult]], Outcome]]
) -> None:
    """Write the page of a data set with its sections.

    Parameters
    ----------
    archive : Path
        Folder of exported runs.
    out : Path
        File of the page.
    name : str
        Name of the data set, a key of ``SECTIONS``.
    summarise : Mapping[str, callable]
        What makes tables and findings of a study's jobs, by the study's name in the order of the sections. Sections
        of other studies are left out.

    Raises
    ------
    InputError
        If there is no page for the data set, or the archive has no finished runs of a section.
    """
    if name not in SECTIONS:
        raise InputError(f"dataset: expected one of {', '.join(sorted(SECTIONS))}, received {name}")
    parts = [HEADS[name] + WRITTEN.format(name=name)]
    for study, summary in summarise.items():
        sections = [section for section in SECTIONS[name] if section.study == study]
        # A configuration is text, and the slowest part of a run to read.
        jobs = [(run, archived_result(run)) for run in finished_jobs(archive, study)] if sections else []
        for section in sections:
            chosen = [(run, result) for run, result in jobs if _is_of(result.config, section, name)]
            if not chosen:
                raise InputError(
                    f"{archive}: expected finished runs of {study} on {name} by "
                    f"trainer.accelerator={section.accelerator}, found none"
                )
            parts.append(_section(section, summary, sorted(chosen, key=lambda job: job[0].start_ms)))
    files.write_text(out, "\n".join(parts).strip() + "\n")


def _is_of(config: Mapping[str, Any], section: Section, name: str) -> bool:
    datasets = [str(part.get("_target_", "")) for key in ("dataset", "second") if (part := config.get(key))]
    return (
        any(f".{name}." in target for target in datasets)
        and config["trainer"]["accelerator"] == section.accelerator
    )


def _of_whole_seeds(jobs: list[Job]) -> list[Job]:
    """The jobs of those seeds of a network and recipe that have all their folds."""
    of_seed: dict[tuple[Any, ...], list[Job]] = {}
    for run, result in jobs:
        config = result.config
        kind = (run.tags.get("model"), *result.choices.items(), config["seed"], config["split"]["folds"])
        of_seed.setdefault(kind, []).append((run, result))
    kept = {run.run_id for kind, own in of_seed.items() if len(own) >= kind[-1] for run, _ in own}
    return [(run, result) for run, result in jobs if run.run_id in kept]


def _recipe(config: Mapping[str, Any]) -> dict[str, str]:
    """What differs from the default recipe, by short names."""
    flat = {key: VALUES.get(str(value), str(value)) for key, value in flatten(config).items()}
    changed = {
        short: flat[key] for key, (short, default) in RECIPE.items() if flat.get(key, default) != default
    }
    return changed or {"recipe": "default"}


def _section(section: Section, summary: Callable[[list[JobResult]], Outcome], jobs: list[Job]) -> str:
    told_apart = [(run, replace(result, choices=_recipe(result.config))) for run, result in jobs]
    whole = _of_whole_seeds(told_apart) if section.study == "segmentation" else told_apart
    outcome = summary([result for _, result in whole])
    commits = sorted({run.tags.get("mlflow.source.git.commit", "unknown")[:12] for run, _ in whole})
    machines = sorted({run.tags.get("ctus.machine", "unknown") for run, _ in whole})
    commands, left_out = "\n".join(section.commands), len(jobs) - len(whole)
    rest = f" Runs of seeds that lack folds, left out: {left_out}." if left_out else ""
    return (
        f"## {section.title}\n\n```\n{commands}\n```\n\nCommit {', '.join(commits)}; {len(whole)} runs; "
        f"{', '.join(machines)}.{rest}\n\n{markdown(dict(outcome.tables))}\n{listed(outcome.findings)}\n"
    )
