"""LaTeX tables: any text is printed as it is."""

from __future__ import annotations

import pandas as pd
import pytest

from experiments.studies.report.latex import escaped, latex_document, latex_table


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("50 % of tre_mm & more", r"50 \% of tre\_mm \& more"),
        ("a\\input{x}", r"a\textbackslash{}input\{x\}"),
        ("$x^2$ ~ #1", r"\$x\textasciicircum{}2\$ \textasciitilde{} \#1"),
        ("< 0.8 ± 0.1\nmm", r"\textless{} 0.8 \ensuremath{\pm} 0.1 mm"),
        ("Grün, 血管", "Grün, ??"),
    ],
)
def test_what_means_something_to_latex_is_escaped(text: str, expected: str) -> None:
    assert escaped(text) == expected


def test_numbers_stand_to_the_right_and_rows_are_whole() -> None:
    table = latex_table(pd.DataFrame({"a_b": ["x|y"], "n": [3], "v": [0.12345]}), "50 %", "one")
    assert r"\begin{tabular}{lrr}" in table
    assert r"a b & n & v \\" in table
    assert r"x\textbar{}y & 3 & 0.123 \\" in table
    assert r"\caption{50 \%}" in table and r"\label{tab:one}" in table


def test_the_document_reads_every_table() -> None:
    document = latex_document({"one": "First", "two": "Second_"})
    assert document.index(r"\input{one}") < document.index(r"\input{two}")
    assert r"\section*{Second\_}" in document
