"""The one exception that says the caller's input is at fault, not the program."""


class InputError(ValueError):
    """An argument or a file is not what it must be; the message names it, what was expected and what was found."""
