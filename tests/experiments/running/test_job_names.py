"""Labels and folders of jobs: readable, and never the same for two jobs."""

from __future__ import annotations

import itertools

import pytest

from experiments.running.job_names import choices_of, distinct_labels, folder_names


def test_a_plain_label_is_a_plain_folder() -> None:
    labels = {"k1": "seed=0,part=1", "k2": "model=attention_unet,trainer.learning_rate=1e-3", "k3": "seed=-1"}
    assert folder_names(labels) == {
        "k1": "seed-0_part-1",
        "k2": "model-attention_unet_trainer.learning_rate-1e-3",
        "k3": "seed--1",
    }


@pytest.mark.parametrize(
    "labels",
    [
        ("dataset.root=/d/a/b", "dataset.root=/d/a_b"),
        ("dataset.root=/d/p/A", "dataset.root=/d/p-A"),
        ("model=A", "model=a"),
        ("model=\u00e4", "model=a\u0308"),
        ("part=a_fold-1", "part=a,fold=1"),
        ("parts=[1,2]", "parts=(1,2)", "parts=_1_2_"),
        (f"root={'x' * 100}/1", f"root={'x' * 100}/2", f"root={'x' * 100}_1"),
        ("a=1", "a='1'", 'a="1"'),
    ],
)
def test_no_two_labels_share_a_folder(labels: tuple[str, ...]) -> None:
    names = folder_names({f"{number}": label for number, label in enumerate(labels)})
    folded = {name.casefold() for name in names.values()}
    assert len(folded) == len(labels)
    # Nor do they in two calls that leave their results in one folder.
    alone = [folder_names({"k": label})["k"] for label in labels]
    for one, other in itertools.combinations(alone, 2):
        assert one != other
    assert all(len(name) <= 93 and "/" not in name for name in folded)


def test_equal_labels_are_told_apart_by_the_jobs() -> None:
    assert distinct_labels(
        {"aaaaaaaaaaaaaaaa": "factors=noise", "bbbbbbbbbbbbbbbb": "factors=noise", "c": "x"}
    ) == {
        "aaaaaaaaaaaaaaaa": "factors=noise,job=aaaaaaaaaaaa",
        "bbbbbbbbbbbbbbbb": "factors=noise,job=bbbbbbbbbbbb",
        "c": "x",
    }
    assert distinct_labels({"a": "", "b": ""}) == {"a": "job=a", "b": "job=b"}
    assert distinct_labels({"a": ""}) == {"a": ""}


def test_choices_are_read_from_a_label() -> None:
    label = "augmentation=strong,parts=[1,2],root='/a,b=c',rigid={x:1,y:2},seed=0"
    assert choices_of(label) == {
        "augmentation": "strong", "parts": "[1,2]", "root": "'/a,b=c'", "rigid": "{x:1,y:2}", "seed": "0"
    }  # fmt: skip
    assert choices_of("") == {}
