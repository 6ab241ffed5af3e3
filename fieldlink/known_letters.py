"""Letters that the fonts of pictures and paper have: those that they lack are written as numbers.

    with_known_letters("FC 泵")   # "FC [U+6CF5]"

The fonts are Matplotlib's own (DejaVu Sans), the same on every machine. A letter without a glyph
would be left out, or be an empty box, and one loop's picture look like another's.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import matplotlib as mpl
from matplotlib.ft2font import FT2Font

__all__ = ["FONT_FILES", "has_known_letters", "with_known_letters"]

FONT_FILES = tuple(
    Path(mpl.get_data_path()) / "fonts" / "ttf" / name
    for name in ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf")
)
"""The regular font, and the bold one."""


def with_known_letters(text: str) -> str:
    """Return the text with ``[U+6CF5]`` and the like for letters that the fonts lack."""
    if has_known_letters(text):
        return text
    known = _letters()
    return "".join(c if ord(c) in known or c.isspace() else f"[U+{ord(c):04X}]" for c in text)


def has_known_letters(text: str) -> bool:
    """Whether the fonts have every letter of the text."""
    return text.isascii() or all(ord(c) in _letters() or c.isspace() for c in text)


@lru_cache(maxsize=1)
def _letters() -> frozenset[int]:
    regular, bold = (frozenset(FT2Font(str(file)).get_charmap()) for file in FONT_FILES)
    return regular & bold
