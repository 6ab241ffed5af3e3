"""Which column of a recording is which signal, as people and historians name them.

    guess_columns(("Date", "FC101.OP", "FC101.PV"), {}).columns    # {"op": 1, "pv": 2, "time": 0}

A heading is read word by word: ``FC101.OP``, ``PV_FC101``, ``Controller output (%)`` and
``Sollwert`` say what they are. What is left of a heading is the loop's name; columns of one loop
belong together.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

__all__ = [
    "DATE_WORDS",
    "PANDAS_INDEX",
    "SIGNAL_WORDS",
    "UMLAUTS",
    "ColumnGuess",
    "guess_columns",
    "loops_side_by_side",
    "note_of_left_out",
    "quality_columns",
]

SIGNAL_WORDS: Mapping[str, tuple[str, ...]] = {
    "op": (
        "op",
        "out mv co output controlleroutput manipulatedvariable manipulatedvalue valve "
        "valveposition lmn stellgroesse stellwert stellsignal sortie salida uscita saida",
    ),
    "pv": (
        "pv",
        "processvariable processvalue measurement meas measuredvalue istwert prozesswert "
        "regelgroesse mesure medida misura medicao",
    ),
    "sp": ("sp", "setpoint sv setvalue sollwert fuehrungsgroesse consigne consigna"),
    "auto": ("auto", "automatic automatik automode", "mode betriebsart"),
    "time": (
        "time",
        "timestamp datetime dateandtime datetimeutc timestring tstamp zeitstempel utc ts "
        "horodatage",
        "zeit uhrzeit heure hora t seconds sekunden",
        "date datum day fecha data",
    ),
}
"""By role, the words that name it, the plainest first; words of one group are equally plain."""

DATE_WORDS = frozenset(SIGNAL_WORDS["time"][-1].split())
"""Headings of a column of dates, beside which another may hold the times of day."""

_QUALIFIERS = frozenset(
    ("average", "avg", "mean", "value", "val", "cv", "raw", "actual", "act", "interpolated")
)
"""Words behind a signal's name that say how it was stored: ``OUT.CV``, ``FC101.PV - Average``."""
_QUALITY_WORDS = frozenset(("quality", "qual", "status", "state", "q", "qualitaet"))

_SHOWN = 5
"""Headings that a sentence names."""

PANDAS_INDEX = "__index_level_0__"
"""What pandas calls an index without a name in a Parquet file; of moments, it is the time."""

UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})


@dataclass(frozen=True, slots=True)
class ColumnGuess:
    """What the headings say.

    Attributes:
        columns: role to number of its column.
        ambiguous: role to the headings that may all be meant.
        unsure: roles whose heading names them only vaguely (``mode``, ``date``).
    """

    columns: Mapping[str, int]
    ambiguous: Mapping[str, tuple[str, ...]]
    unsure: frozenset[str]


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A column that may be meant: how plain its word is (0 is plainest), and the loop's name."""

    number: int
    group: int
    loop: str


def guess_columns(header: Sequence[str], named: Mapping[str, int]) -> ColumnGuess:
    """Return the columns of op, pv, sp, auto and time found in the headings.

    Args:
        header: the headings.
        named: role to column, as the user said; these are not guessed, and tell the loop.
    """
    taken = set(named.values())
    found = {
        role: [c for c in _candidates(role, header) if c.number not in taken]
        for role in SIGNAL_WORDS
        if role not in named
    }
    loops = {
        candidate.loop
        for role, number in named.items()
        for candidate in _candidates(role, header)
        if candidate.number == number
    } | {group[0].loop for role in ("op", "pv") if len(group := found.get(role, [])) == 1}
    loops.discard("")
    columns: dict[str, int] = {}
    ambiguous: dict[str, tuple[str, ...]] = {}
    unsure = set()
    for role, candidates in found.items():
        # A time belongs to every loop of the file.
        fitting = candidates if role == "time" else _of_loops(candidates, loops)
        if role in ("sp", "auto") and "op" not in columns and "op" not in named:
            continue
        if len(fitting) == 1:
            columns[role] = fitting[0].number
            taken.add(fitting[0].number)
            if fitting[0].group == len(SIGNAL_WORDS[role]) - 1 and role in ("auto", "time"):
                unsure.add(role)
        elif fitting:
            ambiguous[role] = tuple(header[candidate.number] for candidate in fitting)
    return ColumnGuess(columns, ambiguous, frozenset(unsure))


def loops_side_by_side(header: Sequence[str], *, alone: bool = False) -> dict[str, dict[str, str]]:
    """Return the loops of a table with several beside each other, such as ``A.OP,A.PV,B.OP,B.PV``.

    Args:
        header: the headings.
        alone: whether a loop counts that is the only one; otherwise only one beside which another
            has OP or PV.

    Returns:
        The headings of op and pv by role, by loop in the order of the table; nothing where no loop
        has one OP and one PV, or one has no name.
    """
    found = _columns_by_loop(header)
    if "" in found:
        return {}
    loops = {
        _as_written(key, own["op"][0]): {role: names[0] for role, names in own.items()}
        for key, own in found.items()
        if _is_whole(own)
    }
    return loops if alone or len(found) > 1 else {}


def note_of_left_out(header: Sequence[str]) -> tuple[str, ...]:
    """Return a sentence on the columns of OP that `loops_side_by_side` leaves out, if there are."""
    names = [
        name
        for own in _columns_by_loop(header).values()
        if not _is_whole(own)
        for name in own.get("op", ())
    ]
    shown = ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "")
    return (f"left out, not one OP with one PV: {shown}",) if names else ()


def _columns_by_loop(header: Sequence[str]) -> dict[str, dict[str, list[str]]]:
    """The headings of OP and PV by role, by loop; several where several are equally plain."""
    found: dict[str, dict[str, list[_Candidate]]] = {}
    for role in ("op", "pv"):
        for candidate in _meant(role, header):
            found.setdefault(candidate.loop, {}).setdefault(role, []).append(candidate)
    return {
        loop: {
            role: [header[one.number] for one in _plainest(candidates)]
            for role, candidates in own.items()
        }
        for loop, own in found.items()
    }


def _is_whole(own: Mapping[str, Sequence[str]]) -> bool:
    return [len(own.get(role, ())) for role in ("op", "pv")] == [1, 1]


def _as_written(loop: str, heading: str) -> str:
    """A loop's name as a heading has it; its plain words where they are not found there."""
    pattern = "[^a-z0-9]+".join(map(re.escape, loop.split(".")))
    for letter, plain in UMLAUTS.items():
        pattern = pattern.replace(str(plain), f"(?:{plain}|{chr(letter)})")
    found = re.search(pattern, heading, re.IGNORECASE)
    return loop if found is None else found[0]


def _of_loops(candidates: Sequence[_Candidate], loops: set[str]) -> list[_Candidate]:
    """The candidates of the loops that are known; those without a loop's name where none is."""
    if not loops:
        return list(candidates)
    own = [candidate for candidate in candidates if candidate.loop in loops]
    return own or [candidate for candidate in candidates if not candidate.loop]


def _candidates(role: str, header: Sequence[str]) -> list[_Candidate]:
    """The columns whose headings name a role in its plainest words."""
    # A heading that is the word itself is meant before one that has it beside others.
    best = _plainest(_meant(role, header))
    bare = [c for c in best if not c.loop]
    return bare if role == "time" and bare else best


def _plainest(candidates: Sequence[_Candidate]) -> list[_Candidate]:
    plainest = min((candidate.group for candidate in candidates), default=0)
    return [candidate for candidate in candidates if candidate.group == plainest]


def _meant(role: str, header: Sequence[str]) -> list[_Candidate]:
    """The columns whose headings name a role."""
    found = []
    for number, heading in enumerate(header):
        words = _split(heading)
        for group, known in enumerate(SIGNAL_WORDS[role]):
            loop = _rest(words, known.split())
            if loop is not None:
                found.append(_Candidate(number, group, loop))
                break
    return found


def _split(heading: str) -> list[str]:
    """The words of a heading, without what stands in brackets."""
    plain = re.sub(r"[\[(].*?[\])]", " ", heading).casefold().translate(UMLAUTS)
    words = [word for word in re.split(r"[^a-z0-9]+", plain) if word]
    while len(words) > 1 and words[-1] in _QUALIFIERS and not _is_signal(words[-2:]):
        words.pop()
    return words


def _is_signal(words: Sequence[str]) -> bool:
    """Whether the words together name a signal: ``process value``."""
    return any(
        "".join(words) in known.split() for groups in SIGNAL_WORDS.values() for known in groups
    )


def quality_columns(
    header: Sequence[str], found: Mapping[str, int | None]
) -> dict[int, tuple[str, ...]]:
    """Return the columns of quality with the roles whose values they judge.

    ``FC101.PV.Quality`` judges ``FC101.PV``; a column that is only called ``quality`` judges all.

    Args:
        header: the headings.
        found: number of each role's column.
    """
    names = {role: _split(header[number]) for role, number in found.items() if number is not None}
    judged: dict[int, tuple[str, ...]] = {}
    for number, heading in enumerate(header):
        words = _split(heading)
        if number in found.values() or not words or words[-1] not in _QUALITY_WORDS:
            continue
        own = tuple(role for role, name in names.items() if name == words[:-1])
        roles = tuple(names) if words in (["quality"], ["qual"], ["status"]) else own
        if roles:
            judged[number] = roles
    return judged


def _rest(words: Sequence[str], known: Sequence[str]) -> str | None:
    """What is left of a heading without the word it is known by; None where it has none."""
    for size in (3, 2, 1):
        # The signal stands at the end of a tag, or at its begin.
        for start in (len(words) - size, 0):
            if start >= 0 and "".join(words[start : start + size]) in known:
                return ".".join([*words[:start], *words[start + size :]])
    return None
