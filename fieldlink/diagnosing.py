"""From recorded files or a historian to diagnoses: one loop, or many of the same hours.

Loops are read and diagnosed one at a time in worker processes; `diagnosed_plant` keeps little of
each and finds the groups.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldlink.diagnosed_plant import (
    Answer,
    DiagnosisError,
    Plant,
    answer_of,
    diagnose_recording,
    plant_of,
)
from fieldlink.errors import FieldlinkError
from fieldlink.site.missing_rows import fill_missing_rows
from fieldlink.site.recording import Recording, files_in, open_recordings, read_recording

__all__ = [
    "Columns",
    "DiagnosisError",
    "Plant",
    "diagnose_files",
    "diagnose_loops",
    "diagnose_recording",
    "diagnose_store",
    "files_of",
    "loops_in",
    "read",
]

Floats = NDArray[np.float64]
Read = Callable[[], Recording]
"""Reads a loop of a file that is open."""

LEAST_SAMPLES = 50
"""Samples of a stored loop below which no window is tried: the shortest that a site file allows."""
MOST_SLOTS = 3_000_000
"""Slots of a stored loop: a month at 1 s. What is beyond a longer pause is left out."""
_SIGNALS = ("op", "pv", "sp", "auto")
_FEW = 4
"""Loops up to which starting worker processes takes longer than the work."""
_READ_AHEAD = 2
"""Loops of one file that are read ahead for each worker: none waits, and few are held at once."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Names of a file's columns, its period and OP's span, where they are not the usual ones.

    ``loop`` names one of a file's loops, None where all are meant; ``op_span`` is in units of OP.
    """

    op: str | None = None
    pv: str | None = None
    sp: str | None = None
    auto: str | None = None
    time: str | None = None
    period: float | None = None
    loop: str | None = None
    op_span: float | None = None

    def names(self) -> dict[str, str | None]:
        """The columns by role."""
        return {role: getattr(self, role) for role in ("op", "pv", "sp", "auto", "time")}


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


def loops_in(path: Path, columns: Columns) -> dict[str, Read]:
    """Open a recorded file: by loop, what reads it; the only loop has no name. PV may be missing.

    Raises:
        RecordingError: see `fieldlink.site.recording.open_recordings`.
    """
    loops = open_recordings(path, columns.names(), columns.period, needs_pv=False)
    return {name: partial(_filled, read_one) for name, read_one in loops.items()}


def read(path: Path, columns: Columns) -> Recording:
    """Read a recorded loop, the one that ``columns`` names of several; PV may be missing.

    Raises:
        RecordingError: see `fieldlink.site.recording.read_recording`.
    """
    recording = read_recording(
        path, **columns.names(), period=columns.period, loop=columns.loop, needs_pv=False
    )
    return fill_missing_rows(recording)


def _filled(read_one: Read) -> Recording:
    return fill_missing_rows(read_one())


def diagnose_files(files: Mapping[str, Path], columns: Columns) -> Plant:
    """Diagnose recorded loops of the same hours, and find the groups that swing together.

    A file may hold several loops, which have their names in it. Of many files each is read by a
    worker process, which diagnoses its loops; few are read here, see `diagnose_loops`.

    Raises:
        DiagnosisError: none of the files can be read.
    """
    if len(files) <= _FEW:
        spread = partial(_spread, op_span=columns.op_span)
        found = [_answers_of_file(path, columns, spread) for path in files.values()]
    else:
        with _workers() as pool:
            in_turn = partial(_in_turn, op_span=columns.op_span)
            work = partial(_answers_of_file, columns=columns, answer_all=in_turn)
            found = list(pool.map(work, files.values()))
    answered = (
        (name, loop, answer)
        for name, answers in zip(files, found, strict=True)
        for loop, answer in answers
    )
    return plant_of(list(answered))


def diagnose_loops(path: Path, loops: Mapping[str, Read], op_span: float | None = None) -> Plant:
    """Diagnose the loops of one file, and find the groups that swing together.

    The file is read here, a loop at a time, and worker processes diagnose.

    Args:
        path: the file.
        loops: as `loops_in` gives them.
        op_span: OP's span in its own units, of all of them; None if not known.

    Raises:
        DiagnosisError: none of the loops can be read.
    """
    return plant_of([(path.stem, name, answer) for name, answer in _spread(loops, op_span)])


def diagnose_store(
    url: str,
    periods: Mapping[str, float],
    hours: float,
    op_spans: Mapping[str, float | None] | None = None,
) -> Plant:
    """Diagnose the loops of a historian by its last hours.

    Args:
        url: the historian.
        periods: by loop, plant seconds between two samples.
        hours: of the clock, back from now.
        op_spans: by loop, OP's span in its own units where that is known.

    Raises:
        DiagnosisError: no loop has samples enough.
    """
    since = datetime.now(UTC) - timedelta(hours=hours)
    work = partial(_one_stored, url=url, since=since, op_spans=op_spans or {})
    if len(periods) <= _FEW:
        found = list(map(work, periods.items()))
    else:
        with _workers() as pool:
            found = list(pool.map(work, periods.items()))
    return plant_of([(name, "", answer) for name, answer in zip(periods, found, strict=True)])


def _workers() -> ProcessPoolExecutor:
    # a fresh process has no threads of ours that a fork would copy half
    return ProcessPoolExecutor(os.cpu_count() or 1, mp_context=get_context("spawn"))


_ByLoop = Iterable[tuple[str, Answer]]


def _answers_of_file(
    path: Path, columns: Columns, answer_all: Callable[[Mapping[str, Read]], _ByLoop]
) -> list[tuple[str, Answer]]:
    try:
        loops = loops_in(path, columns)
    except FieldlinkError as error:
        return [("", str(error))]
    # the only loop of a file has the file's name
    return [(name if len(loops) > 1 else "", answer) for name, answer in answer_all(loops)]


def _in_turn(loops: Mapping[str, Read], op_span: float | None = None) -> _ByLoop:
    for name, read_one in loops.items():
        recording = _read_or_reason(read_one)
        if isinstance(recording, str):
            yield name, recording
        else:
            yield name, answer_of(recording, op_span=op_span)


def _spread(loops: Mapping[str, Read], op_span: float | None = None) -> _ByLoop:
    """Read here and diagnose in worker processes; a few loops here too."""
    if len(loops) <= _FEW:
        yield from _in_turn(loops, op_span)
        return
    ahead: deque[tuple[str, Future[Answer] | str]] = deque()
    with _workers() as pool:
        for name, read_one in loops.items():
            recording = _read_or_reason(read_one)
            if isinstance(recording, str):
                ahead.append((name, recording))
            else:
                ahead.append((name, pool.submit(answer_of, recording, op_span=op_span)))
            if len(ahead) > _READ_AHEAD * (os.cpu_count() or 1):
                first, answer = ahead.popleft()
                yield first, answer if isinstance(answer, str) else answer.result()
        for name, answer in ahead:
            yield name, answer if isinstance(answer, str) else answer.result()


def _read_or_reason(read_one: Read) -> Recording | str:
    try:
        return read_one()
    except FieldlinkError as error:
        return str(error)


def _one_stored(
    place: tuple[str, float], url: str, since: datetime, op_spans: Mapping[str, float | None]
) -> Answer:
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
    return answer_of(recording, op_span=op_spans.get(loop))
