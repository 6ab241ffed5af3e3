"""Which tags of a register map belong to which loop, and in which role, as far as names show.

    found = propose_loops(tags)
    found.loops[0].roles      # {"op": "FC101.OP", "pv": "FC101.PV"}
    found.loops[0].unclear    # {"sp": ("FC101.SP", "FC101.SV")}: a person has to choose

A name is read word by word in the vocabulary of `column_names`; what is left is the loop's name.
Where two tags fit equally well, none is chosen here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from fieldlink.registers import DataType, Tag
from fieldlink.site.column_names import SIGNAL_WORDS, UMLAUTS

__all__ = ["ROLES", "LoopProposal", "Proposal", "propose_loops", "roles_in_name"]

ROLES = ("op", "pv", "sp", "mode", "scan")
"""The roles of a loop in the site file."""

_WORDS: Mapping[str, tuple[frozenset[str], ...]] = {
    **{
        role: tuple(frozenset(group.split()) for group in SIGNAL_WORDS[name])
        for role, name in (("op", "op"), ("pv", "pv"), ("sp", "sp"), ("mode", "auto"))
    },
    "scan": (
        frozenset(
            {"scan", "scancount", "scancounter", "cyclecount", "cyclecounter", "zykluszaehler"}
        ),
    ),
    # The control variable (OP) with some makers, the controlled variable (PV) with others.
    "cv": (frozenset({"cv"}),),
}
"""By role, groups of words, the plainest group first."""

_LETTERS: Mapping[str, str] = {"y": "op", "x": "pv", "w": "sp", "z": "disturbance"}
"""The letters of DIN 19226 (Stellgröße, Istwert, Sollwert, Störgröße), too short to stand alone."""

_INTEGERS = frozenset(
    {DataType.INT16, DataType.UINT16, DataType.INT32, DataType.UINT32, DataType.INT64,
     DataType.UINT64}
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class LoopProposal:
    """One loop as its names show it.

    Attributes:
        name: the loop's name.
        roles: role to tag, where one tag alone fits.
        unclear: role to the tags between which a person has to choose.
    """

    name: str
    roles: Mapping[str, str]
    unclear: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def all_tags(self) -> frozenset[str]:
        """Every tag that has, or may have, a role in the loop."""
        choices = (tag for tags in self.unclear.values() for tag in tags)
        return frozenset((*self.roles.values(), *choices))


@dataclass(frozen=True, slots=True)
class Proposal:
    """What the names of a register map show.

    Attributes:
        loops: loops that have, or may have, an OP and a PV, by name.
        halves: groups of tags with an OP and no PV, or a PV and no OP.
    """

    loops: tuple[LoopProposal, ...]
    halves: tuple[LoopProposal, ...]


def propose_loops(tags: Iterable[Tag]) -> Proposal:
    """Return the loops that the names of tags show."""
    groups: dict[str, dict[str, list[tuple[int, str]]]] = {}
    names: dict[str, str] = {}
    for tag in tags:
        for role, plainness, loop in _meanings(tag):
            key = loop.casefold()
            names.setdefault(key, loop)
            groups.setdefault(key, {}).setdefault(role, []).append((plainness, tag.name))
    whole: list[LoopProposal] = []
    halves: list[LoopProposal] = []
    for key, candidates in groups.items():
        found = _as_proposal(names[key], candidates)
        known = {*found.roles, *found.unclear}
        if {"op", "pv"} <= known:
            whole.append(found)
        elif {"op", "pv"} & known:
            halves.append(found)
    joined, left = _join_halves(halves)
    loops = sorted((*whole, *joined), key=lambda loop: loop.name)
    return Proposal(tuple(loops), tuple(left))


def roles_in_name(tag: Tag) -> frozenset[str]:
    """Return the roles that a tag's name shows; none where it shows none."""
    return frozenset(_LETTERS.get(role, role) for role, _, _ in _meanings(tag))


def _as_proposal(name: str, candidates: Mapping[str, list[tuple[int, str]]]) -> LoopProposal:
    roles: dict[str, str] = {}
    unclear: dict[str, tuple[str, ...]] = {}
    letters = _letters_of(candidates)
    for role in ROLES:
        found = candidates.get(role, []) or letters.get(role, [])
        plainest = min((plainness for plainness, _ in found), default=0)
        best = tuple(tag for plainness, tag in found if plainness == plainest)
        if len(best) == 1:
            roles[role] = best[0]
        elif best:
            unclear[role] = best
    missing = [role for role in ("op", "pv") if role not in roles and role not in unclear]
    if "cv" in candidates and len(missing) == 1:
        unclear[missing[0]] = tuple(tag for _, tag in candidates["cv"])
    return LoopProposal(name or "loop", roles, unclear)


def _letters_of(
    candidates: Mapping[str, list[tuple[int, str]]],
) -> dict[str, list[tuple[int, str]]]:
    """Return the tags of single letters by role, where they stand together as a loop's do.

    X and Y are a loop's unless a Z makes coordinates of them; with W they are one in any case.
    """
    found = {role: candidates[letter] for letter, role in _LETTERS.items() if letter in candidates}
    if not {"op", "pv"} <= set(found) or {"op", "pv"} & set(candidates):
        return {}
    return {} if "disturbance" in found and "sp" not in found else found


def _join_halves(halves: list[LoopProposal]) -> tuple[list[LoopProposal], list[LoopProposal]]:
    """Pair an OP and a PV that share a number, such as FV101.OP and FT101.PV, to be asked."""
    joined: list[LoopProposal] = []
    left: list[LoopProposal] = []
    numbers: dict[tuple[bool, str], list[LoopProposal]] = {}
    for half in halves:
        numbers.setdefault((_has(half, "op"), _number_of(half.name)), []).append(half)
    for half in halves:
        is_op, number = _has(half, "op"), _number_of(half.name)
        mates = numbers.get((not is_op, number), []) if number else []
        if len(mates) == 1 and len(numbers[is_op, number]) == 1:
            if is_op:
                mate = mates[0]
                pv = (mate.roles["pv"],) if "pv" in mate.roles else mate.unclear["pv"]
                roles = {role: tag for role, tag in mate.roles.items() if role != "pv"}
                unclear = {**mate.unclear, **half.unclear, "pv": pv}
                joined.append(LoopProposal(half.name, {**roles, **half.roles}, unclear))
            continue
        left.append(half)
    return joined, left


def _has(half: LoopProposal, role: str) -> bool:
    return role in half.roles or role in half.unclear


def _number_of(name: str) -> str:
    digits = re.findall(r"\d+", name)
    return digits[-1] if digits else ""


def _meanings(tag: Tag) -> Iterator[tuple[str, int, str]]:
    """Yield the roles that a tag's name shows: role, plainness (0 is plainest), loop."""
    apart = re.sub(r"[\[(].*?[\])]", " ", tag.name)
    # FC101OP has no separator: the signal begins after the number.
    for text in (apart, re.sub(r"(?<=\d)(?=[A-Za-z]{2})", " ", apart)):
        words = [word for word in re.split(r"[\W_]+", text) if word]
        found = list(_read_words(words, tag.data_type))
        if found:
            yield from found
            return


def _read_words(words: list[str], data_type: DataType) -> Iterator[tuple[str, int, str]]:
    plain = [word.casefold().translate(UMLAUTS) for word in words]
    is_known = False
    for role, groups in _WORDS.items():
        if not _can_be(role, data_type):
            continue
        for plainness, known in enumerate(groups):
            rest = _without(words, plain, known)
            if rest is not None:
                is_known = True
                yield role, plainness, "_".join(rest)
                break
    if not is_known and len(words) > 1 and plain[-1] in _LETTERS and _can_be("op", data_type):
        yield plain[-1], 0, "_".join(words[:-1])


def _without(words: list[str], plain: list[str], known: frozenset[str]) -> list[str] | None:
    """Return the words without those that name the signal, at the end or the start of a name."""
    for size in (3, 2, 1):
        for start in (len(words) - size, 0):
            if start >= 0 and "".join(plain[start : start + size]) in known:
                return [*words[:start], *words[start + size :]]
    return None


def _can_be(role: str, data_type: DataType) -> bool:
    if role == "mode":
        return data_type is not DataType.STRING
    if role == "scan":
        return data_type in _INTEGERS
    return data_type not in (DataType.STRING, DataType.BOOL)
