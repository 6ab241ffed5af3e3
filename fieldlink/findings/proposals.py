"""What one round shows, as findings to be: one for each group, one for each cause outside groups.

The loops of a group that only follow its source get no finding of their own for the oscillation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from fieldlink.findings.observed import ObservedGroup, ObservedLoop

__all__ = ["Proposal", "propose"]

NO_FINDING = frozenset({"quiet", "undetermined"})
"""Causes that ask for no action."""

SOURCES = ("sticky_valve", "tight_tuning")
"""Causes by which a loop makes an oscillation itself."""

FOLLOWING = frozenset({"external_oscillation", "tight_tuning", "sticky_valve"})
"""Causes that the loops of a group may show because of its source. A second sticky valve is a
candidate of the group; once the first is repaired, it shows by itself."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A finding as one round shows it; the fields are those of `OpenFinding`.

    Attributes:
        covers: loop and cause of every cause that belongs to it.
        seen_ms: end of its newest window.
    """

    cause: str
    loop: str
    loops: tuple[str, ...]
    swing_period_s: float | None
    weight: float
    evidence: tuple[str, ...]
    action: str
    seen_ms: int
    candidates: tuple[Mapping[str, Any], ...] = ()
    covers: frozenset[tuple[str, str]] = field(default_factory=frozenset)


def propose(loops: Mapping[str, ObservedLoop], groups: tuple[ObservedGroup, ...]) -> list[Proposal]:
    """Return the findings of a round, groups first.

    Args:
        loops: what was diagnosed, by loop.
        groups: those that swing together; members that are not in ``loops`` are left out.
    """
    found: list[Proposal] = []
    for group in groups:
        if (one := _of_group(loops, group)) is not None:
            _add(found, one)
    covered = {pair for one in found for pair in one.covers}
    for name, loop in loops.items():
        for cause in loop.causes:
            if cause.name in NO_FINDING or (name, cause.name) in covered:
                continue
            found.append(
                Proposal(
                    cause=cause.name,
                    loop=name,
                    loops=(name,),
                    swing_period_s=loop.swing_period_s,
                    weight=cause.weight,
                    evidence=cause.evidence,
                    action=cause.action,
                    seen_ms=loop.end_ms,
                    covers=frozenset({(name, cause.name)}),
                )
            )
    return found


def _add(found: list[Proposal], one: Proposal) -> None:
    """Add a group; what one loop makes with several periods is one finding."""
    for number, before in enumerate(found):
        if one.loop and (one.loop, one.cause) == (before.loop, before.cause):
            more = tuple(name for name in one.loops if name not in before.loops)
            found[number] = replace(
                before, loops=(*before.loops, *more), covers=before.covers | one.covers
            )
            return
    found.append(one)


def _of_group(loops: Mapping[str, ObservedLoop], group: ObservedGroup) -> Proposal | None:
    members = tuple(name for name in group.loops if name in loops)
    candidates = tuple(
        one for one in group.candidates if one["loop"] is None or one["loop"] in members
    )
    if len(members) < 2 or not candidates:
        return None
    first = candidates[0]
    source = str(first["loop"] or "")
    cause, action = "external_oscillation", "Look for a machine, a batch or a loop that is not "
    action += "among these and swings with the same period."
    if source:
        own = [found for name in SOURCES if (found := loops[source].cause(name)) is not None]
        cause = own[0].name if own else "undetermined"
        action = own[0].action if own else ""
        action = action or (
            f"Put {source} in manual for a few periods: if the others calm down, it is the source."
        )
    covers = {
        (name, following)
        for name in members
        for following in FOLLOWING
        if following == "sticky_valve" or loops[name].swings_with(group.period_s)
    }
    if source:
        covers.add((source, cause))
    return Proposal(
        cause=cause,
        loop=source,
        loops=members,
        swing_period_s=group.period_s,
        weight=float(first["weight"]),
        evidence=tuple(map(str, first["evidence"])),
        action=action,
        seen_ms=max(loops[name].end_ms for name in members),
        candidates=candidates,
        covers=frozenset(covers),
    )
