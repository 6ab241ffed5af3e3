"""What can go wrong with a plant. Every message says what happened and what to do next."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = [
    "PlantBuildError",
    "PlantClosedError",
    "PlantCrashError",
    "PlantEndedError",
    "PlantError",
    "PlantFileError",
    "PlantInputError",
    "PlantNameError",
    "PlantStepError",
    "PlantTimeoutError",
]


class PlantError(RuntimeError):
    """Anything that went wrong with a plant."""


class PlantBuildError(PlantError):
    """An FMU of the catalogue could not be built from its source."""


class PlantFileError(PlantError):
    """The file is not an FMU that can run here."""


class PlantNameError(PlantError, KeyError):
    """A model or a variable that does not exist, or not in this role."""

    __str__ = RuntimeError.__str__  # KeyError would show the message in quotes


class PlantInputError(PlantError, ValueError):
    """A value that the plant cannot take."""


class PlantStepError(PlantError):
    """The FMU refused to start or to step, or put out something that is not a number."""


class PlantEndedError(PlantStepError):
    """The FMU ended its simulation in order: there is no step after this one."""


class PlantCrashError(PlantError):
    """The plant's process died."""


class PlantTimeoutError(PlantCrashError):
    """The plant did not answer in time; its process was ended."""


class PlantClosedError(PlantError):
    """The plant was closed, or failed before."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the nearest known ones, or all."""
    names = sorted(known)
    plain = {known_name.lower(): known_name for known_name in names}
    close = difflib.get_close_matches(name.lower(), plain, n=3, cutoff=0.5)
    if close:
        return f"did you mean {' or '.join(repr(plain[match]) for match in close)}?"
    if not names:
        return "there are none"
    shown = ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
    return f"there are: {shown}"
