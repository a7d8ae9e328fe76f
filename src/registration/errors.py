"""The one exception that says the caller's input is at fault, not the program."""

_ESCAPED = {code: repr(chr(code))[1:-1] for code in (*range(32), *range(127, 160))}


class InputError(ValueError):
    """An argument or a file is not what it must be; the message names it, what was expected and what was found."""

    def __str__(self) -> str:
        """The message in one line: what it quotes of a file may hold line ends and commands to a terminal."""
        return super().__str__().translate(_ESCAPED)
