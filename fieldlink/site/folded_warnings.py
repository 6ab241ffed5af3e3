"""Warnings that hold for many loops or devices, one line each.

list(fold([Warned("loop", "FC101", "no end"), Warned("loop", "FC102", "no end")]))
# ["2 loops (FC101, FC102): no end"]
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

__all__ = ["Warned", "fold", "shown"]

_NAMED = 5
"""The most names that a warning lists: enough to find the others, and the line stays readable."""


@dataclass(frozen=True, slots=True)
class Warned:
    """A warning of one loop or device.

    Attributes:
        about: what it is about.
        name: of the loop or device.
        what: the sentence behind the name.
        of_many: the same sentence without names of this one alone, such as tags; empty where
            ``what`` has none.
    """

    about: Literal["loop", "device"]
    name: str
    what: str
    of_many: str = ""


def fold(warnings: Iterable[Warned]) -> Iterator[str]:
    """Yield the warnings as text, those that say the same in one line, where the first stood."""
    alike: dict[tuple[str, str], list[Warned]] = {}
    for warned in warnings:
        alike.setdefault((warned.about, warned.of_many or warned.what), []).append(warned)
    for (about, text), found in alike.items():
        names = list(dict.fromkeys(warned.name for warned in found))
        if len(names) == 1:
            yield from (f"{about} {warned.name}: {warned.what}" for warned in found)
        else:
            yield f"{len(names)} {about}s ({shown(names)}): {text}"


def shown(names: Sequence[str], most: int = _NAMED) -> str:
    """Return the first names, at most so many, and how many there are besides."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")
