"""The view of results: one row a result, its columns kept from one study's call to the next."""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path

import pytest

from experiments.tracking import Store
from experiments.tracking.saved_view import MOST_COLUMNS, VIEW_TAG, columns_of, view_tag


def test_the_view_filters_results_and_orders_settings_before_metrics() -> None:
    tag = json.loads(view_tag(["model"], ["dsc_mean", "dsc_std"]))
    assert tag["name"] == "Results"
    state = json.loads(zlib.decompress(base64.b64decode(tag["state"].removeprefix("deflate;"))))
    assert state["searchFilter"] == "tags.level = 'result'"
    wanted = ["params.`model`", "metrics.`dsc_mean`", "metrics.`dsc_std`"]
    assert state["selectedColumns"] == state["columnOrder"] == wanted


def test_columns_of_another_call_stay_and_nothing_changes_where_none_is_new() -> None:
    first = view_tag(["model"], ["dsc_mean"])
    second = view_tag(["augmentation"], ["dsc_mean"], first)
    assert columns_of(second) == ["params.`model`", "params.`augmentation`", "metrics.`dsc_mean`"]
    assert view_tag(["model"], ["dsc_mean"], second) is second


def test_a_view_has_room_for_few_columns_and_keeps_the_metrics() -> None:
    tag = view_tag([f"p{number}" for number in range(60)], ["dsc_mean"])
    assert len(columns_of(tag)) == MOST_COLUMNS and columns_of(tag)[-1] == "metrics.`dsc_mean`"
    assert len(tag) < 5000


@pytest.mark.parametrize("tag", ["", "nonsense", "{}", '{"state": "deflate;xyz"}', '{"state": "[]"}'])
def test_what_is_no_view_has_no_columns(tag: str) -> None:
    assert columns_of(tag) == []
    assert columns_of(view_tag(["a"], [], tag)) == ["params.`a`"]


def test_an_experiment_gets_its_view_once(home: Path) -> None:
    store = Store()
    for _ in range(2):
        store.save_view("segmentation", ["model"], ["dsc_mean"])
    tags = store.client().get_experiment_by_name("segmentation").tags
    assert columns_of(tags[VIEW_TAG]) == ["params.`model`", "metrics.`dsc_mean`"]
    assert tags["mlflow.experimentKind"] == "custom_model_development"
