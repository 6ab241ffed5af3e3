"""Seeds of a test: the first ones in the suite, all of them with ``make thorough``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import pytest

__all__ = ["cases_in_suite", "few_and_all", "in_suite"]


def in_suite(kept: int, values: Iterable[object]) -> list[Any]:
    """Return the values as parameters, those behind the first ``kept`` marked ``thorough``."""
    return [
        pytest.param(value, marks=() if rank < kept else pytest.mark.thorough)
        for rank, value in enumerate(values)
    ]


def cases_in_suite(kept: int, cases: Iterable[tuple[object, ...]]) -> list[Any]:
    """Return cases of several values each, those behind the first ``kept`` marked ``thorough``."""
    return [
        pytest.param(*case, marks=() if rank < kept else pytest.mark.thorough)
        for rank, case in enumerate(cases)
    ]


def few_and_all(few: int, values: Sequence[object]) -> list[Any]:
    """Return the first values for the suite and all of them for ``make thorough``, as parameters.

    For a test that counts over its seeds: it asks for the same share of few and of all.
    """
    return [
        pytest.param(values[:few], id="few"),
        pytest.param(values, id="all", marks=pytest.mark.thorough),
    ]
