"""The work list of recorded loops, of files with one loop or several, judged by the estimator now.

The files are read here, a loop at a time; worker processes judge. So no more is held than one file,
and the newest part of the loops that are judged or in the list.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator import EstimatorError, Interval
from fieldlink.errors import FieldlinkError
from fieldlink.one_window import keep_newest
from fieldlink.printable import as_text
from fieldlink.site.recorded_loops import distinct_names
from fieldlink.worklist.finding import Cause, Finding, Wrong, finding_of_estimate
from fieldlink.worklist.from_store import Diagnose, ReportedLoop
from fieldlink.worklist.partial import PartialReport
from fieldlink.worklist.row import Confidence, WorkRow
from fieldlink.worklist.settings import WorkListSettings
from fieldlink.worklist.window_samples import WindowSamples, figures_of, interval_of

if TYPE_CHECKING:
    from fieldlink.site.recording import Recording

__all__ = ["judge_recordings"]

_AHEAD = 2
"""Loops that are read ahead for each worker: none waits, and few are held at once."""

_Opened = tuple[Path, "dict[str, Callable[[], Recording]] | str"]
"""A file, and by loop what reads it; or why it cannot be read."""


class _Place(NamedTuple):
    """Where a loop is: its file, and its name where the file has several, else nothing."""

    file: Path
    loop: str


@dataclass(frozen=True, slots=True, eq=False)
class _Judged:
    """What comes back from a worker."""

    samples: WindowSamples
    document: dict[str, Any]
    notes: tuple[str, ...]


def judge_recordings(
    files: Sequence[Path],
    *,
    settings: WorkListSettings | None = None,
    period: float | None = None,
    workers: int = 1,
    progress: Callable[[str, int, int], None] = lambda _name, _done, _all: None,
    diagnose: Diagnose = lambda _name, _samples: None,
    partial: PartialReport | None = None,
) -> list[ReportedLoop]:
    """Judge recordings and return their loops, the most urgent first.

    Args:
        files: recordings, see `fieldlink.site.recording.open_recordings`; the only loop of a file
            has the file's name, and of two of one name those of files with several are called by
            their file too.
        settings: see `WorkListSettings`.
        period: seconds between rows; the files' own unless given.
        workers: processes that judge.
        progress: called with a loop's name, how many are done, and how many are known so far.
        diagnose: see `fieldlink.worklist.list_loops`.
        partial: gives the loops that an earlier run has judged, and keeps those of this one.

    Raises:
        RecordingError: the only file cannot be used; one among others is a row that says so.
        EstimatorError: the only loop of the only file holds no window of a loop.
    """
    chosen = settings or WorkListSettings()
    files = list(dict.fromkeys(files))
    names = dict(zip(files, _names(files), strict=True))
    opened: Iterable[_Opened] = ((file, _open_or_explain(file, period)) for file in files)
    if len(files) == 1:
        name, loops = names[files[0]], _open(files[0], period)
        if len(loops) == 1:
            progress(name, 0, 1)
            (read,) = loops.values()
            return [_reported(name, _judge(_newest(read)), chosen, diagnose)]
        opened = [(files[0], loops)]
    readings = _Readings(opened, len(files))
    places, found = [], []
    with _judging(readings, period, workers, partial) as results:
        for number, (place, judged) in enumerate(results):
            name = as_text(place.loop) or names[place.file]
            progress(name, number, readings.known)
            places.append((names[place.file], as_text(place.loop)))
            if isinstance(judged, str):
                found.append(_unusable(name, judged, chosen))
            else:
                found.append(_reported(name, judged, chosen, diagnose))
    found = [_renamed(loop, tag) for loop, tag in zip(found, distinct_names(places), strict=True)]
    return sorted(found, key=lambda loop: (loop.row.urgency, loop.row.tag))


class _Readings:
    """The loops of files, read one after the other; a sentence in place of one that cannot be.

    ``known`` is the number of loops known so far: a file is taken for one loop until it is open.
    """

    def __init__(self, opened: Iterable[_Opened], files: int) -> None:
        self._opened = opened
        self.known = files

    def __iter__(self) -> Iterator[tuple[_Place, Recording | str]]:
        for file, loops in self._opened:
            if isinstance(loops, str):
                yield _Place(file, ""), loops
                continue
            self.known += len(loops) - 1
            for name, read in loops.items():
                yield _Place(file, name if len(loops) > 1 else ""), _newest_or_explain(read)


@contextmanager
def _judging(
    readings: Iterable[tuple[_Place, Recording | str]],
    period: float | None,
    workers: int,
    partial: PartialReport | None,
) -> Iterator[Iterator[tuple[_Place, _Judged | str]]]:
    """Give the results as they come, in other processes where there are several.

    What was judged before is taken from there; the others are on disk before they are given.
    """

    def keep(place: _Place, judged: _Judged | str) -> tuple[_Place, _Judged | str]:
        if partial is not None:
            partial.keep(place.file, period, _kept(judged), loop=place.loop)
        return place, judged

    def give(pool: ProcessPoolExecutor | None) -> Iterator[tuple[_Place, _Judged | str]]:
        running: dict[Future[_Judged | str], _Place] = {}
        for place, recording in readings:
            kept = None if partial is None else partial.find(place.file, period, loop=place.loop)
            if isinstance(recording, str):
                yield place, recording
            elif kept is not None:
                yield place, _of_kept(recording, kept)
            elif pool is None:
                yield keep(place, _judge_or_explain(recording))
            else:
                running[pool.submit(_judge_or_explain, recording)] = place
                if len(running) >= _AHEAD * workers:
                    for done in wait(running, return_when=FIRST_COMPLETED).done:
                        yield keep(running.pop(done), done.result())
        while running:
            for done in wait(running, return_when=FIRST_COMPLETED).done:
                yield keep(running.pop(done), done.result())

    if workers < 2:
        yield give(None)
        return
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        try:
            yield give(pool)
        except BaseException:
            # Ctrl-C waits for the windows under way, not for those in the queue.
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _kept(judged: _Judged | str) -> dict[str, Any]:
    """Return a result as plain types."""
    if isinstance(judged, str):
        return {"problem": judged}
    stem = judged.samples.stem
    return {
        "document": judged.document,
        "notes": list(judged.notes),
        "stem": None if stem is None else stem.tolist(),
    }


def _of_kept(recording: Recording, kept: Mapping[str, Any]) -> _Judged | str:
    """Return a result again; the samples are those of the recording."""
    if "problem" in kept:
        return str(kept["problem"])
    stem = None if kept["stem"] is None else np.asarray(kept["stem"], float)
    samples = _samples(recording, stem)
    return _Judged(samples, dict(kept["document"]), tuple(kept["notes"]))


def _names(files: Sequence[Path]) -> list[str]:
    """Return the files' names without ending; with folder and ending where two are the same."""
    found = [file.stem for file in files]
    for longer in (lambda file: str(file.with_suffix("")), str):
        found = [
            name if found.count(name) == 1 else longer(file)
            for name, file in zip(found, files, strict=True)
        ]
    return [as_text(name) for name in found]


def _renamed(loop: ReportedLoop, tag: str) -> ReportedLoop:
    """The loop by a name that no other has, with a remark where that is not its own."""
    row = loop.row
    if row.tag == tag:
        return loop
    remark = f"{row.tag} is in more than one file: this one is called {tag}"
    return replace(loop, row=replace(row, tag=tag, remarks=(*row.remarks, remark)))


def _judge_or_explain(recording: Recording) -> _Judged | str:
    """Judge a recording; return a sentence where that fails, so that the others go on."""
    try:
        return _judge(recording)
    except (FieldlinkError, EstimatorError) as error:
        return as_text(str(error))


def _unusable(name: str, problem: str, settings: WorkListSettings) -> ReportedLoop:
    """The row of a recording that cannot be used."""
    cause = Cause(Wrong.UNREADABLE, ("the recording cannot be used",))
    finding = Finding((cause,), (problem,), is_sure=False)
    row = WorkRow(tag=name, device="", finding=finding, limit=settings.stick_band_limit)
    return ReportedLoop(row, None, None, None, settings.span_of())


def _open(file: Path, period: float | None) -> dict[str, Callable[[], Recording]]:
    from fieldlink.site.recording import open_recordings

    return open_recordings(file, {}, period)


def _open_or_explain(file: Path, period: float | None) -> dict[str, Callable[[], Recording]] | str:
    try:
        return _open(file, period)
    except FieldlinkError as error:
        return as_text(str(error))


def _newest(read: Callable[[], Recording]) -> Recording:
    from fieldlink.site.missing_rows import fill_missing_rows

    return keep_newest(fill_missing_rows(read()))


def _newest_or_explain(read: Callable[[], Recording]) -> Recording | str:
    try:
        return _newest(read)
    except FieldlinkError as error:
        return as_text(str(error))


def _judge(recording: Recording) -> _Judged:
    from estimator import identify

    result = identify(
        recording.op,
        recording.pv,
        sp=recording.sp,
        auto=_mode(recording),
        period=recording.period,
    )
    stem = result.stem if result.verdict.value == "stiction" else None
    samples = _samples(recording, stem)
    return _Judged(samples, result.to_dict(), recording.notes)


def _mode(recording: Recording) -> NDArray[np.float64] | None:
    return None if recording.auto is None else recording.auto.astype(np.float64)


def _samples(recording: Recording, stem: NDArray[np.float64] | None) -> WindowSamples:
    return WindowSamples(
        recording.op, recording.pv, recording.sp, stem, recording.period, _mode(recording)
    )


def _reported(
    name: str, judged: _Judged, settings: WorkListSettings, diagnose: Diagnose
) -> ReportedLoop:
    document, samples = judged.document, judged.samples
    span = settings.span_of(samples.op)
    oscillates, period = samples.swing
    finding = diagnose(name, samples) or finding_of_estimate(
        document, oscillates=oscillates, period_s=period if oscillates else None
    )
    sticks = document["verdict"] == "stiction"
    S, J = (
        interval_of(document[key]).scaled(100.0 / span) if sticks else Interval.unknown()
        for key in ("stick_band", "slip_jump")
    )
    row = WorkRow(
        tag=name,
        device="",
        finding=finding,
        stick_band=S,
        slip_jump=J,
        interval_confidence=float(document["confidence"]),
        limit=settings.stick_band_limit,
        figures=figures_of(samples, document, span),
        # One window cannot agree with another.
        confidence=Confidence.MEDIUM if finding.is_sure else Confidence.LOW,
        agreeing=1,
        judged=1,
        windows=1,
        remarks=judged.notes,
    )
    return ReportedLoop(row, samples, None, None, span)
