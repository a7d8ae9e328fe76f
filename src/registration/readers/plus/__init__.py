"""Sequences, device sets and results of the PLUS toolkit."""

from registration.readers.plus.reader import PlusReader

__all__ = ["PlusReader"]
