"""The one exception for faults of the caller's input, not of the program."""


class InputError(ValueError):
    """An argument or a file is not what it must be; the message names it, what was expected and what was found."""
