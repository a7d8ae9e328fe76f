"""Tables as LaTeX: one file a table, to be read in by a paper, and one document of all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from experiments.running.terminal import cell_text

if TYPE_CHECKING:
    import pandas as pd

# What pdflatex with its standard fonts has no letter for.
_COMMANDS = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "±": r"\ensuremath{\pm}",
    "×": r"\ensuremath{\times}",
    "≤": r"\ensuremath{\le}",
    "≥": r"\ensuremath{\ge}",
    "−": r"\ensuremath{-}",
    "°": r"\ensuremath{^\circ}",
    "µ": r"\ensuremath{\mu}",
}
_LAST_LATIN = 0x17F
_DOCUMENT = r"""\documentclass[a4paper,landscape]{article}
\usepackage[utf8]{inputenc}
\usepackage[T1]{fontenc}
\usepackage[margin=15mm]{geometry}
\usepackage{booktabs,graphicx}
\begin{document}
%s
\end{document}
"""
# A table wider than the text is made as small as it must be, a narrow one stays as it is.
_TABLE = r"""%% Needs \usepackage{booktabs,graphicx}.
\begin{table}[htbp]
\centering
\caption{%(caption)s}
\label{tab:%(label)s}
\sbox0{%%
\begin{tabular}{%(columns)s}
\toprule
%(head)s \\
\midrule
%(rows)s
\bottomrule
\end{tabular}}%%
\ifdim\wd0>\linewidth\resizebox{\linewidth}{!}{\usebox0}\else\usebox0\fi
\end{table}
"""


def escaped(text: str) -> str:
    r"""Write any text so that LaTeX prints it as it is.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    str
        LaTeX; a letter that its standard fonts do not have becomes a question mark.

    Examples
    --------
    >>> escaped("50 % of tre_mm")
    '50 \\% of tre\\_mm'
    """
    letters = (
        _COMMANDS.get(letter, letter if ord(letter) <= _LAST_LATIN else "?")
        for letter in " ".join(text.split())
    )
    return "".join(letters)


def latex_table(frame: pd.DataFrame, caption: str, label: str) -> str:
    """Write a table.

    Parameters
    ----------
    frame : pandas.DataFrame
        Table.
    caption : str
        Caption, as plain text.
    label : str
        Label after ``tab:``.

    Returns
    -------
    str
        A ``table`` environment, with numbers to the right.
    """
    columns = "".join("r" if frame[name].dtype.kind in "if" else "l" for name in frame.columns)
    rows = [
        " & ".join(escaped(cell_text(value)) for value in row) + r" \\"
        for row in frame.itertuples(index=False)
    ]
    return _TABLE % {
        "caption": escaped(caption),
        "label": label,
        "columns": columns,
        "head": " & ".join(escaped(str(name).replace("_", " ")) for name in frame.columns),
        "rows": "\n".join(rows),
    }


def latex_document(captions: Mapping[str, str]) -> str:
    """Write a document of all tables.

    Parameters
    ----------
    captions : Mapping[str, str]
        Headings by the stem of a table's file.

    Returns
    -------
    str
        A document that pdflatex compiles in the folder of the tables.
    """
    # Many floats in a row need a place to go to.
    parts = [
        f"\\section*{{{escaped(caption)}}}\n\\input{{{stem}}}\n\\clearpage"
        for stem, caption in captions.items()
    ]
    return _DOCUMENT % "\n".join(parts)
