"""Start values as they are typed: numbers, words of booleans and enumerations, texts of strings."""

from __future__ import annotations

from fieldlink.lab.fmu.signals import words_of
from fmu_models import FmuSummary, StartValue

__all__ = ["read_start_value"]


def read_start_value(fmu: FmuSummary, name: str, text: str) -> StartValue:
    """Return what ``text`` stands for as a start value of a variable.

    A name that the FMU does not have is taken for one of a number; opening the FMU refuses it.

    Args:
        fmu: what `fmu_models.summarise` says of it.
        name: of the variable, or of an element of an array.
        text: as typed.

    Raises:
        ValueError: it is not a number and no word of the variable; the message says what it may be.
    """
    variable = fmu.variable(name)
    if variable is not None and variable.type in ("String", "Binary"):
        return text  # binary data is refused where the FMU is opened
    words = words_of(variable)
    if text in words:
        return words[text]
    try:
        return {"true": 1.0, "false": 0.0}[text] if text in ("true", "false") else float(text)
    except ValueError:
        known = f" or one of {', '.join(words)}" if words else ""
        raise ValueError(f"{text!r} is not a number{known}") from None
