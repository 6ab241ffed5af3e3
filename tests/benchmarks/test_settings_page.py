"""The page of the estimator's settings is what their docstrings and values give today."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from benchmarks.settings_page import compensator_page, entries_of, page

PAGE = Path(__file__).resolve().parents[2] / "docs" / "settings.md"


@dataclass(frozen=True)
class _Complete:
    """Some numbers.

    Attributes:
        first: the first one, in seconds,
            as long as it takes.
        second, third: how many: of both; fourth: a share.
    """

    first: float = 1.0
    second: int = 2
    third: int = 3
    fourth: float = 0.5


@dataclass(frozen=True)
class _Incomplete:
    """Two numbers.

    Attributes:
        first: the first one.
    """

    first: float = 1.0
    second: int = 2


def test_the_pages_are_current() -> None:
    assert PAGE.read_text() == page(), "run python -m benchmarks.settings_page --out docs"
    other = PAGE.with_name("compensator-settings.md")
    assert other.read_text() == compensator_page(), "run python -m benchmarks.settings_page"


def test_entries_are_read_with_their_continuations_and_neighbours() -> None:
    assert list(entries_of(_Complete())) == [
        (("first",), "the first one, in seconds, as long as it takes"),
        (("second", "third"), "how many: of both"),
        (("fourth",), "a share"),
    ]


def test_a_field_without_a_sentence_is_named() -> None:
    with pytest.raises(ValueError, match="_Incomplete has no sentence for second"):
        list(entries_of(_Incomplete()))
