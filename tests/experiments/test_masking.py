"""Passwords in addresses are masked wherever they stand, and nothing else is."""

from __future__ import annotations

import pytest

from experiments.masking import masked, masked_values


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("postgresql://me:s3cret@db:5432/x", "postgresql://***@db:5432/x"),
        ("postgresql+psycopg2://me:a/b:c@d@db.example/x", "postgresql+psycopg2://***@db.example/x"),
        (
            "https://token@host/mlflow and https://a:b@[::1]:5000",
            "https://***@host/mlflow and https://***@[::1]:5000",
        ),
        ("mysql://db/x?user=me&password=s3cret&ssl=1", "mysql://db/x?user=me&password=***&ssl=1"),
        ("mysql://db/x?token=s3cret'", "mysql://db/x?token=***'"),
        ("uri: 'http://u:p@h:1'\n", "uri: 'http://***@h:1'\n"),
        ("http://host:5000/#/runs", "http://host:5000/#/runs"),
        ("sqlite:////srv/ctus.db", "sqlite:////srv/ctus.db"),
        ("mail someone@example.org, see http://x.org", "mail someone@example.org, see http://x.org"),
        ("dataset=usgra seed=1", "dataset=usgra seed=1"),
    ],
)
def test_addresses(text: str, expected: str) -> None:
    assert masked(text) == expected
    assert masked(expected) == expected


def test_every_text_of_a_configuration() -> None:
    config = {
        "tracking": {"uri": "http://u:p@h", "enabled": True},
        "list": ["http://u:p@h", 1, None],
        "n": 0.5,
    }
    assert masked_values(config) == {
        "tracking": {"uri": "http://***@h", "enabled": True}, "list": ["http://***@h", 1, None], "n": 0.5,
    }  # fmt: skip
