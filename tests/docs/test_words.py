"""The check of words finds what it lists, also over the end of a line."""

from __future__ import annotations

import pytest

from tools.words import finds_in


@pytest.mark.parametrize(
    "text",
    [
        "requests the device does not bear",
        "begun anew, what became of a block",
        '"""A port that\n    cannot be had."""',
        "# it is told by\n# whoever asks",
    ],
)
def test_an_expression_is_found(text: str) -> None:
    assert list(finds_in(text))


def test_the_line_is_named_and_plain_words_pass() -> None:
    assert [line for line, _, _ in finds_in("fine\nWhat became of it\n")] == [2]
    assert not list(finds_in("The value is not a number. The daemon starts again."))
