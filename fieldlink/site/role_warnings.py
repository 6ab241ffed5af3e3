"""Signals of a loop that are exchanged, as far as the names of their tags show."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

from fieldlink.site.checked_site import Site
from fieldlink.site.folded_warnings import Warned
from fieldlink.site.loop_proposal import roles_in_name

__all__ = ["find_role_warnings"]

_EXCHANGED = ("op", "pv", "sp")
"""The roles that a slip exchanges: numbers of one kind, next to each other in the site file."""


def find_role_warnings(site: Site, name: str) -> Iterator[Warned]:
    """Yield the pairs of roles of the loop ``name`` of which each has a tag named for the other.

    One tag alone with another name is no slip: the OP of a master is the SP of its slave.
    """
    tags = {role: tag for role in _EXCHANGED if (tag := site.tag(name, role)) is not None}
    said = {role: roles_in_name(tag) for role, tag in tags.items()}
    for one, other in combinations(tags, 2):
        if said[one] == {other} and said[other] == {one}:
            roles = f"{one.upper()} and {other.upper()}"
            yield Warned(
                "loop",
                name,
                f"{one} is {tags[one].name} and {other} is {tags[other].name}: by their names "
                f"{roles} are exchanged; if they are, exchange the two lines",
                f"{roles} are exchanged by the names of their tags; if they are, exchange the "
                "lines of each loop",
            )
