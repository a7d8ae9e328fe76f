import unicodedata

import pytest

from experiments.errors import InputError
from experiments.unicode_names import same_name, text_names


def test_names_that_look_alike_are_the_same() -> None:
    plain = "Fr\u00e4n\u00e7oise_\u00e9"
    assert same_name(unicodedata.normalize("NFD", plain)) == same_name(plain) == plain


def test_names_of_a_setting_are_text_or_whole_numbers() -> None:
    assert text_names("groups", ["e\u0301", 8]) == ("\u00e9", "8")
    with pytest.raises(InputError, match=r"groups: expected names as text, received 1\.1 of type float"):
        text_names("groups", [1.1])
    with pytest.raises(InputError, match="groups: expected a list of names, received 'ab'"):
        text_names("groups", "ab")
