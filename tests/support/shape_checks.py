"""The run-time checker behind the tests: every array that an annotation gives a shape is checked.

Each function's first calls of a test are checked, then one in so many: a search calls the same few functions ten
thousands of times in the same loop, and checking took a tenth of all the tests' time.

jaxtyping's import hook decorates every function and class of the packages. What names no array is left as it is (mypy
has checked it), and a checker is compiled when its function is first called: a test process imports some thousand
functions and calls a part of them, and compiling a checker costs milliseconds.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype

# An int where a float is expected is fine, as it is to a type checker.
enforce = beartype(conf=BeartypeConf(is_pep484_tower=True))
FIRST, EVERY = 32, 16
ARRAY = re.compile(r"\b(Float|Int|UInt|Bool|Shaped|Integer|Num|Real|Inexact|Complex)\d*\[")


def install(packages: list[str]) -> None:
    """Check the arrays in the signatures of what is imported from these packages from now on."""
    check = jaxtyping.jaxtyped

    def where_arrays_are_named(*, typechecker: Callable[..., Any]) -> Callable[[Any], Any]:
        return lambda named: checked_from_first_call(named, check(typechecker=typechecker))

    jaxtyping.jaxtyped = where_arrays_are_named
    jaxtyping.install_import_hook(packages, "shape_checks.enforce")


def names_an_array(named: Any) -> bool:
    """Whether an annotation of a function or a field gives an array's type and shape."""
    annotations = getattr(named, "__annotations__", {}).values()
    return any(ARRAY.search(each if isinstance(each, str) else str(each)) for each in annotations)


def checked_from_first_call(named: Any, check: Callable[[Any], Any]) -> Any:
    """The function or class itself, or with its arrays checked at every call."""
    if not names_an_array(named):
        return named
    if isinstance(named, type):
        plain = named.__init__  # type: ignore[misc]
        made = check(named)
        if (checker := made.__init__) is not plain:
            made.__init__ = sampled(plain, lambda: checker)
        return made
    return sampled(named, functools.cache(lambda: check(named)))


class Tests:
    """Which test runs: each counts its calls from the first, whatever ran before it in its process."""

    number = 0


def sampled(plain: Callable[..., Any], checker: Callable[[], Callable[..., Any]]) -> Callable[..., Any]:
    """The function with its arrays checked in the first calls of a test, and in one of so many after them."""
    calls = number = 0

    @functools.wraps(plain)
    def called(*args: Any, **kwargs: Any) -> Any:
        nonlocal calls, number
        if number != Tests.number:
            calls, number = 0, Tests.number
        calls += 1
        if calls > FIRST and calls % EVERY:
            return plain(*args, **kwargs)
        return checker()(*args, **kwargs)

    return called
