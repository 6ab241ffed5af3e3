"""From recorded files or a historian to diagnoses: one loop, or many of the same hours.

Loops are read and diagnosed one at a time in worker processes; what is kept of each is its
diagnosis and a thinned copy of its signals, by which groups are found. So the memory grows with the
number of loops and not with the length of their records.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldlink.common_hours import clock_notes
from fieldlink.diagnosis import Diagnosis, Group, LoopSignals, diagnose, find_groups
from fieldlink.errors import FieldlinkError
from fieldlink.site.missing_rows import fill_missing_rows
from fieldlink.site.recording import Recording, files_in, read_recording

__all__ = [
    "Columns",
    "DiagnosisError",
    "Plant",
    "diagnose_files",
    "diagnose_recording",
    "diagnose_store",
    "files_of",
]

Floats = NDArray[np.float64]

_KEPT = 20_000
"""Samples of a loop that are kept to find groups: a day at 4.3 s, a period of 20 s and slower."""
LEAST_SAMPLES = 50
"""Samples of a stored loop below which no window is tried: the shortest that a site file allows."""
MOST_SLOTS = 3_000_000
"""Slots of a stored loop: a month at 1 s. What is beyond a longer pause is left out."""
_SIGNALS = ("op", "pv", "sp", "auto")
_FEW = 4
"""Loops up to which starting worker processes takes longer than the work."""


class DiagnosisError(FieldlinkError):
    """There is nothing that could be diagnosed."""


_NAMED = 5
"""Loops that a note names; the others are counted."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Names of a file's columns and its period, where they are not the usual ones."""

    op: str | None = None
    pv: str | None = None
    sp: str | None = None
    auto: str | None = None
    time: str | None = None
    period: float | None = None


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

    def to_dict(self) -> dict[str, Any]:
        """The JSON object of ``fieldlink diagnose --json`` for several loops."""
        return {
            "loops": {name: found.to_dict() for name, found in self.loops.items()},
            "groups": [group.to_dict() for group in self.groups],
            "refused": dict(self.refused),
            "notes": list(self.notes),
        }


def files_of(paths: Sequence[Path]) -> dict[str, Path]:
    """The recorded files by loop name: those given, and those in the folders given.

    Raises:
        DiagnosisError: a folder without recordings, a file given twice, or two of one name.
    """
    found: dict[str, Path] = {}
    for path in paths:
        inside = files_in(path)
        if not inside:
            raise DiagnosisError(f"{path}: the folder holds no recording; name one that does")
        for file in inside:
            if file.stem in found and file.resolve() == found[file.stem].resolve():
                raise DiagnosisError(f"{file} is given twice; name it once, or only its folder")
            if file.stem in found:
                raise DiagnosisError(
                    f"{file} and {found[file.stem]} have the same name, and the name is the "
                    f"loop's; rename one"
                )
            found[file.stem] = file
    return found


def read(path: Path, columns: Columns) -> Recording:
    """Read a recorded loop; PV may be missing."""
    recording = read_recording(
        path,
        op=columns.op,
        pv=columns.pv,
        sp=columns.sp,
        auto=columns.auto,
        time=columns.time,
        period=columns.period,
        needs_pv=False,
    )
    return fill_missing_rows(recording)


def diagnose_recording(recording: Recording, *, advice: bool = True) -> Diagnosis:
    """Diagnose one recorded loop."""
    has_pv = bool(np.isfinite(recording.pv).any())
    return diagnose(
        recording.op,
        recording.pv if has_pv else None,
        recording.sp if has_pv else None,
        auto=recording.auto,
        period=recording.period,
        advice=advice,
    )


def diagnose_files(files: Mapping[str, Path], columns: Columns) -> Plant:
    """Diagnose recorded loops of the same hours, and find the groups that swing together.

    Raises:
        DiagnosisError: none of the files can be read.
    """
    return _diagnose_all(files, partial(_one_file, columns=columns))


def diagnose_store(url: str, periods: Mapping[str, float], hours: float) -> Plant:
    """Diagnose the loops of a historian by its last hours.

    Args:
        url: the historian.
        periods: by loop, plant seconds between two samples.
        hours: of the clock, back from now.

    Raises:
        DiagnosisError: no loop has samples enough.
    """
    since = datetime.now(UTC) - timedelta(hours=hours)
    return _diagnose_all(
        {name: (name, period) for name, period in periods.items()},
        partial(_one_stored, url=url, since=since),
    )


_Answer = tuple[Diagnosis, LoopSignals, tuple[str, ...]] | str
"""The diagnosis of a loop, its thinned signals and notes; or why it was not read."""


def _diagnose_all(places: Mapping[str, Any], work: Callable[[Any], _Answer]) -> Plant:
    if len(places) <= _FEW:
        answers = [work(place) for place in places.values()]
    else:
        # a fresh process has no threads of ours that a fork would copy half
        context = get_context("spawn")
        with ProcessPoolExecutor(os.cpu_count() or 1, mp_context=context) as pool:
            answers = list(pool.map(work, places.values()))
    loops: dict[str, Diagnosis] = {}
    signals: dict[str, LoopSignals] = {}
    refused: dict[str, str] = {}
    read: dict[str, tuple[str, ...]] = {}
    for name, answer in zip(places, answers, strict=True):
        if isinstance(answer, str):
            refused[name] = answer
        else:
            loops[name], signals[name], read[name] = answer
    if not loops:
        raise DiagnosisError("\n".join(refused.values()) or "no loop given; name a file or folder")
    copies = _copies(signals)
    notes = (*clock_notes(signals), *_copy_notes(copies), *_reading_notes(read))
    signals = _aligned(signals)
    # a recording swings together with itself: that tells nothing of the plant
    asked = {name: one for name, one in signals.items() if name not in copies}
    groups = find_groups(asked, {name: loops[name] for name in asked}) if len(asked) > 1 else ()
    return Plant(loops, groups, refused, signals, notes)


def _one_file(path: Path, columns: Columns) -> _Answer:
    try:
        recording = read(path, columns)
    except FieldlinkError as error:
        return str(error)
    return diagnose_recording(recording), _thinned(recording), recording.notes


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
    return tuple(
        f"{', '.join(names[:_NAMED])}"
        f"{f' and {len(names) - _NAMED} more' if len(names) > _NAMED else ''}: {note}"
        for note, names in about.items()
    )


def _one_stored(place: tuple[str, float], url: str, since: datetime) -> _Answer:
    from fieldlink.assess.series import Series, equally_spaced
    from fieldlink.store import read_samples

    loop, period = place
    frame = read_samples(url, loop, since=since)
    if len(frame) < LEAST_SAMPLES:
        return (
            f"{loop}: {len(frame)} samples in the store since {since:%Y-%m-%d %H:%M} UTC; "
            f"{LEAST_SAMPLES} are needed: let the daemon run, or give more --hours"
        )
    signals: dict[str, Floats] = {
        name: np.asarray(frame[name].astype("float64"), dtype=np.float64) for name in _SIGNALS
    }
    has = {name: bool(np.isfinite(values).any()) for name, values in signals.items()}
    if not (has["op"] and has["pv"]):
        return f"{loop}: no good sample of OP and PV since {since:%Y-%m-%d %H:%M} UTC"
    stamps = frame["time"].dt.tz_localize(None).to_numpy()
    times = stamps.astype("datetime64[ms]").astype(np.int64) / 1000.0
    # each sample in its slot; what was missed stays NaN
    stored = Series(
        time=times,
        op=signals["op"],
        pv=signals["pv"],
        sp=signals["sp"] if has["sp"] else None,
        auto=signals["auto"] if has["auto"] else None,
        period=period,
        dated=True,
        slot=frame["slot"].to_numpy(dtype=np.int64),
    )
    even = equally_spaced(stored, MOST_SLOTS)
    recording = Recording(
        path=Path(loop),
        op=even.op,
        pv=even.pv,
        sp=even.sp,
        # a missed sample is not a loop in manual
        auto=None if even.auto is None else ~(even.auto <= 0.0),
        period=period,
        time=None,
        irregular=0,
        nan_runs=(),
        notes=(),
        start=float(times[0]),
    )
    return diagnose_recording(recording), _thinned(recording), recording.notes


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
