"""The page of findings: width, remedies that can be copied, exit code."""

from __future__ import annotations

from experiments.command_line.doctor.findings import WIDTH, Finding, State, exit_code, page

GOOD = Finding("Python", State.OK, "Python 3.11")
ABSENT = Finding("disk", State.MISSING, "full " * 60, "mv " + "long" * 40)


def test_no_line_but_a_remedy_is_wider_than_the_terminal() -> None:
    lines = page([GOOD, ABSENT]).splitlines()
    assert [line.strip() for line in lines if len(line) > WIDTH] == [ABSENT.remedy]


def test_the_last_line_says_what_is_missing() -> None:
    assert page([GOOD]).endswith("ctus can work on this machine.")
    assert page([GOOD, ABSENT]).endswith("ctus can't work yet: disk")


def test_a_note_does_not_change_the_exit_code() -> None:
    assert exit_code([GOOD, Finding("GPU", State.NOTE, "none")]) == 0
    assert exit_code([GOOD, ABSENT]) == 1
