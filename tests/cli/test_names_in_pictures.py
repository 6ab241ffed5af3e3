"""Names of files and loops stand in pictures as they are, whatever letters they have."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from fieldlink.known_letters import with_known_letters
from fieldlink.pictures import save, svg


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("FC101", "FC101"),
        ("Насос 7, Kühlwasser Ω", "Насос 7, Kühlwasser Ω"),
        ("泵 1", "[U+6CF5] 1"),
        ("a\n泵", "a\n[U+6CF5]"),
    ],
)
def test_letters_that_the_fonts_lack(name: str, written: str) -> None:
    assert with_known_letters(name) == written


@pytest.mark.parametrize("name", ["p$Q$.csv", "a$x_{$b.csv", "泵$x$.csv"])
def test_a_title_is_no_formula_and_has_no_empty_boxes(name: str, tmp_path: Path) -> None:
    """A dollar sign was the begin of a formula; a missing letter a warning of the library."""
    figure = Figure()
    figure.suptitle(name)
    figure.add_subplot().set_xscale("log")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save(figure, tmp_path / "loop.png")
        assert svg(figure).startswith("<svg")
    assert figure.get_suptitle() == with_known_letters(name)
