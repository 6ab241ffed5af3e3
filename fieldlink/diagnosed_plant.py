"""Diagnoses of many loops of the same hours, put together: what a plant's loops do to each other.

What is kept of a loop is its diagnosis and a thinned copy of its signals, by which groups are
found. So the memory grows with the number of loops and not with the length of their records.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis.settings import DIAGNOSIS
from fieldlink.common_hours import clock_notes
from fieldlink.diagnosis import (
    CauseName,
    Diagnosis,
    Group,
    LoopSignals,
    diagnose,
    find_groups,
)
from fieldlink.errors import FieldlinkError
from fieldlink.site.folded_warnings import shown
from fieldlink.site.recorded_loops import distinct_names
from fieldlink.site.recording import Recording

__all__ = [
    "Answer",
    "Answered",
    "DiagnosisError",
    "Plant",
    "answer_of",
    "diagnose_recording",
    "plant_of",
]

Floats = NDArray[np.float64]

_MOVED = (CauseName.TIGHT_TUNING, CauseName.EXTERNAL_OSCILLATION, CauseName.UNDETERMINED)
"""Causes of a loop by itself that another loop, which moves it, may make."""
_LIKELY = 0.5
"""Weight of a group's first candidate from which it is likelier than all others together."""
_KEPT = 20_000
"""Samples of a loop that are kept to find groups: a day at 4.3 s, a period of 20 s and slower."""


class DiagnosisError(FieldlinkError):
    """There is nothing that could be diagnosed."""


@dataclass(frozen=True, slots=True)
class Plant:
    """Diagnoses of many loops and the groups among them.

    ``refused`` names what was not read, and why; ``signals`` are those by which groups were found;
    ``notes`` say what limits the search for groups and how recordings were read, in sentences.
    """

    loops: Mapping[str, Diagnosis]
    groups: tuple[Group, ...]
    refused: Mapping[str, str]
    signals: Mapping[str, LoopSignals]
    notes: tuple[str, ...] = ()

    def source_of(self, name: str) -> str | None:
        """The loop that likely makes another loop swing; None where its own cause is the word.

        A loop that is moved by another at a period of its own resonance looks tightly tuned, or
        swung from outside: which of them it is only the group tells.
        """
        found = self.loops[name]
        if found.first.name not in _MOVED:
            return None
        for group in self.groups:
            first = group.candidates[0]
            is_other = name in group.loops and first.loop not in (None, name)
            if is_other and first.weight >= _LIKELY and _has_period(found, group.period_s):
                return first.loop
        return None

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of ``fieldlink diagnose --json`` for several loops."""
        return {
            "loops": {name: found.to_dict() for name, found in self.loops.items()},
            "groups": [group.to_dict() for group in self.groups],
            "refused": dict(self.refused),
            "notes": list(self.notes),
        }


def _has_period(found: Diagnosis, period_s: float) -> bool:
    """Whether a loop swings with a group's period, or has none of its own."""
    swing = found.oscillation
    same = DIAGNOSIS.grouping.width
    return not swing.present or abs(swing.period_s / period_s - 1.0) < same


Answer = tuple[Diagnosis, LoopSignals, tuple[str, ...]] | str
"""The diagnosis of a loop, its thinned signals and notes; or why it was not read."""
Answered = tuple[str, str, Answer]
"""Name of the file, name of the loop in it (empty for the only one), and its answer."""


def diagnose_recording(
    recording: Recording, *, advice: bool = True, op_span: float | None = None
) -> Diagnosis:
    """Diagnose one recorded loop; ``op_span``: OP's span in its own units, None if not known."""
    has_pv = bool(np.isfinite(recording.pv).any())
    return diagnose(
        recording.op,
        recording.pv if has_pv else None,
        recording.sp if has_pv else None,
        auto=recording.auto,
        period=recording.period,
        advice=advice,
        op_span=op_span,
    )


def answer_of(recording: Recording, *, op_span: float | None = None) -> Answer:
    """Diagnose one of many loops; the signals are thinned to what finding groups needs.

    ``op_span`` is OP's span in its own units, None if not known.
    """
    return diagnose_recording(recording, op_span=op_span), _thinned(recording), recording.notes


def plant_of(found: Sequence[Answered]) -> Plant:
    """Put the answers of loops together and find the groups that swing together.

    Args:
        found: of every loop; two of one name are called by their files too, with a note.

    Raises:
        DiagnosisError: none of the loops was read.
    """
    loops: dict[str, Diagnosis] = {}
    signals: dict[str, LoopSignals] = {}
    refused: dict[str, str] = {}
    read: dict[str, tuple[str, ...]] = {}
    names = distinct_names([(file, loop) for file, loop, _ in found])
    for name, (_, _, answer) in zip(names, found, strict=True):
        if isinstance(answer, str):
            refused[name] = answer
        else:
            loops[name], signals[name], read[name] = answer
    if not loops:
        # of a file that cannot be read each loop may have the same reason
        reasons = dict.fromkeys(refused.values())
        raise DiagnosisError("\n".join(reasons) or "no loop given; name a file or folder")
    copies = _copies(signals)
    notes = (
        *_twice_notes(names, found),
        *clock_notes(signals),
        *_copy_notes(copies),
        *_reading_notes(read),
    )
    signals = _aligned(signals)
    # a recording swings together with itself: that tells nothing of the plant
    asked = {name: one for name, one in signals.items() if name not in copies}
    groups = find_groups(asked, {name: loops[name] for name in asked}) if len(asked) > 1 else ()
    return Plant(loops, groups, refused, signals, notes)


def _twice_notes(names: Sequence[str], found: Sequence[Answered]) -> tuple[str, ...]:
    """Which loops of several files have the same name, and what they are called therefore."""
    called: dict[str, list[str]] = {}
    for name, (_, loop, _) in zip(names, found, strict=True):
        if loop and name != loop:
            called.setdefault(loop, []).append(name)
    return tuple(
        f"{loop} is in more than one file: called {shown(own)}." for loop, own in called.items()
    )


def _copies(signals: Mapping[str, LoopSignals]) -> dict[str, str]:
    """Recordings with the same moving OP and PV as an earlier one, and that one's name."""
    first: dict[tuple[float, float, bytes, bytes], str] = {}
    copies = {}
    for name, one in signals.items():
        if one.pv is None or not np.nanstd(one.op) + np.nanstd(one.pv) > 0.0:
            continue
        start = one.start_s if np.isfinite(one.start_s) else 0.0
        key = (start, one.period, one.op.tobytes(), one.pv.tobytes())
        if key in first:
            copies[name] = first[key]
        else:
            first[key] = name
    return copies


def _copy_notes(copies: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(
        f"{name} has the OP and PV of {first}, sample by sample, and is left out of the groups: "
        f"export that loop's own tags, or leave the copy out."
        for name, first in copies.items()
    )


def _reading_notes(notes: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """How recordings were read, each sentence once, with the names of those that it is about."""
    about: dict[str, list[str]] = {}
    for name, said in notes.items():
        for note in said:
            about.setdefault(note, []).append(name)
    return tuple(f"{shown(names)}: {note}" for note, names in about.items())


def _thinned(recording: Recording) -> LoopSignals:
    """Return the signals; long ones averaged over a few samples each."""
    every = max(1, -(-len(recording) // _KEPT))

    def thin(values: Floats) -> Any:
        whole = values[: values.size // every * every].reshape(-1, every)
        # hundreds of loops are held at once: single precision is below any transmitter's
        return whole.mean(axis=1).astype(np.float32)

    has_pv = bool(np.isfinite(recording.pv).any())
    return LoopSignals(
        op=thin(recording.op),
        pv=thin(recording.pv) if has_pv else None,
        sp=thin(recording.sp) if has_pv and recording.sp is not None else None,
        period=recording.period * every,
        start_s=recording.start if recording.start is not None else float("nan"),
    )


def _aligned(signals: Mapping[str, LoopSignals]) -> dict[str, LoopSignals]:
    """The signals on one clock; without a clock in every file they all start together."""
    starts = np.array([one.start_s for one in signals.values()])
    if not np.isfinite(starts).all():
        starts = np.zeros(starts.size)
    starts = starts - starts.min()
    return {
        name: replace(one, start_s=float(start))
        for (name, one), start in zip(signals.items(), starts, strict=True)
    }
