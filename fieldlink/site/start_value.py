"""A start value in a TOML file: a number, or the text of a string variable, or a word."""

from __future__ import annotations

import sys
from typing import Annotated

from pydantic import BeforeValidator

__all__ = ["StartValue"]


def _check(value: object) -> float | str:
    """Take numbers, true and false (1 and 0) and texts; a text stays one, also where it is "4"."""
    if isinstance(value, str):
        return value
    if isinstance(value, (bool, int, float)) and abs(value) <= sys.float_info.max:
        return float(value)
    raise ValueError("is not a start value; give a finite number, true, false, or a text in quotes")


StartValue = Annotated[float | str, BeforeValidator(_check)]
"""What a parameter of an FMU is set to; whether it fits its variable is checked with the FMU."""
