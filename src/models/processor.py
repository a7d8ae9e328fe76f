"""The processor that torch computes on: the number of threads, held fixed for a time, and units for 16 bits."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import torch

from models.errors import InputError


@contextlib.contextmanager
def fixed_threads(count: int) -> Iterator[None]:
    """Let torch compute one operation with so many threads, and restore the number before.

    A sum that is divided among threads is rounded according to their number, and a training takes such differences
    to other weights. Whoever wants the same result on every machine and beside any number of other processes
    therefore sets the number, rather than take that of the free cores.

    Parameters
    ----------
    count : int
        Number of threads, from 1.

    Raises
    ------
    InputError
        If the number is below 1.

    Examples
    --------
    >>> with fixed_threads(1):
    ...     torch.get_num_threads()
    1
    """
    if count < 1:
        raise InputError(f"threads: expected at least 1, received {count}")
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def has_bfloat16_units() -> bool:
    """Tell whether the processor multiplies matrices of bfloat16 in units of their own (AMX).

    Elsewhere torch computes in bfloat16 at most as fast as in float32, and by emulation slower.

    Returns
    -------
    bool
        True on Intel's processors from the fourth generation of Xeon on, unless the system withholds the units.
    """
    return bool(torch.cpu.get_capabilities().get("amx_bf16", False))
