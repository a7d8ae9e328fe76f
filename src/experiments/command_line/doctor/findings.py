"""One finding about the machine, and the page that all of them make."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

WIDTH = 100
# The column that texts begin in: after the state and the subject.
_INDENT = 27


class State(Enum):
    """What a finding means for whether ctus can work."""

    OK = "ok"
    NOTE = "note"
    MISSING = "MISSING"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Parameters
    ----------
    subject : str
        What was looked at, in a word or two.
    state : State
        ``MISSING`` where ctus can't work without it, ``NOTE`` where a part of it can't.
    text : str
        What was found.
    remedy : str, optional
        Command line that mends it; empty if there is nothing to mend.
    """

    subject: str
    state: State
    text: str
    remedy: str = ""


def page(findings: Sequence[Finding]) -> str:
    """Write all findings as lines of at most 100 columns, remedies on lines of their own.

    Parameters
    ----------
    findings : sequence of Finding
        Findings in the order that they are shown.

    Returns
    -------
    str
        The page, with a last line that says whether ctus can work. A remedy stands whole on its line, however long, so
        that it can be copied.
    """
    lines = []
    for finding in findings:
        head = f"{finding.state.value:<9}{finding.subject:<{_INDENT - 10}} "
        lines += textwrap.wrap(
            head + finding.text,
            WIDTH,
            subsequent_indent=" " * _INDENT,
            break_long_words=False,
            break_on_hyphens=False,
        )
        if finding.remedy:
            lines.append(f"{' ' * 9}{finding.remedy}")
    missing = [finding.subject for finding in findings if finding.state is State.MISSING]
    closing = f"ctus can't work yet: {', '.join(missing)}" if missing else "ctus can work on this machine."
    return "\n".join([*lines, "", closing])


def exit_code(findings: Sequence[Finding]) -> int:
    """Tell by a number whether ctus can work.

    Parameters
    ----------
    findings : sequence of Finding
        All findings.

    Returns
    -------
    int
        1 if something is missing that ctus needs, else 0.
    """
    return int(any(finding.state is State.MISSING for finding in findings))
