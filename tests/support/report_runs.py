"""Runs that a report is made of, one with a name that is no plain text."""

from __future__ import annotations

import dataclasses

from run_families import job, segmented

from experiments.outcome import InputData
from experiments.tracking.run_record import RunRecord

HOSTILE = "<script>alert(1)</script> & 50 % $x$"


def runs() -> list[RunRecord]:
    """A sweep over two networks on five groups."""
    config = {
        "dataset": {"_target_": "x.Carotid"},
        "call": {
            "options": {"dataset": "carotid", "trainer": "cpu"},
            "command": "ctus -m study=segmentation",
        },
        "trainer": {"_target_": "x.T"},
    }
    tags = {"ctus.command": "ctus -m study=segmentation", "ctus.config_hash": "c" * 64}
    used = (InputData("carotid", "d" * 36, "/home/someone/carotid"),)
    top = job("top00000", None, config, tags={**tags, "ctus.kind": "sweep"})
    models = {"unet": [0.9, 0.92, 0.94, 0.91, 0.9], HOSTILE: [0.8, 0.82, 0.84, 0.81, 0.8]}
    jobs = [
        job(
            f"job{number}",
            segmented(dsc, model).assign(dataset="carotid"),
            config,
            {"dsc_mean": 0.9},
            parent="top00000",
            tags=tags,
        )
        for number, (model, dsc) in enumerate(models.items())
    ]
    return [top, *(dataclasses.replace(one, inputs=used) for one in jobs)]
