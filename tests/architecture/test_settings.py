"""Every chosen number of the estimator is a setting with a sentence, and they fit on a page."""

from __future__ import annotations

import re
from dataclasses import FrozenInstanceError, fields, is_dataclass

import pytest

from estimator.settings import SETTINGS

GROUPS = [getattr(SETTINGS, group.name) for group in fields(SETTINGS)]


def test_settings_fit_on_a_page() -> None:
    assert all(is_dataclass(group) for group in GROUPS)
    assert sum(len(fields(group)) for group in GROUPS) < 60


def _described(docstring: str) -> set[str]:
    """Names that the ``Attributes:`` of a docstring give a sentence."""
    attributes = docstring.split("Attributes:")[1]
    named = re.findall(r"^ {8}((?:\w+, )*\w+): \w", attributes, flags=re.MULTILINE)
    named += re.findall(r"; ((?:\w+, )*\w+): \w", attributes)
    return {name for names in named for name in names.split(", ")}


@pytest.mark.parametrize("group", GROUPS, ids=lambda g: type(g).__name__)
def test_every_setting_has_a_sentence_and_every_sentence_a_setting(group: object) -> None:
    assert _described(type(group).__doc__ or "") == {field.name for field in fields(group)}


@pytest.mark.parametrize("group", [SETTINGS, *GROUPS], ids=lambda g: type(g).__name__)
def test_settings_are_frozen_and_refuse_unknown_names(group) -> None:
    with pytest.raises(FrozenInstanceError):
        setattr(group, fields(group)[0].name, 1)
    with pytest.raises(TypeError, match="unknown"):
        type(group)(unknown=1)
