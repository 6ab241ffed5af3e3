"""The work list of recorded loops: one file a loop, each judged by the estimator now."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimator import EstimatorError, Interval
from fieldlink.errors import FieldlinkError
from fieldlink.one_window import keep_newest
from fieldlink.printable import as_text
from fieldlink.worklist.finding import Cause, Finding, Wrong, finding_of_estimate
from fieldlink.worklist.from_store import Diagnose, ReportedLoop
from fieldlink.worklist.partial import PartialReport
from fieldlink.worklist.row import Confidence, WorkRow
from fieldlink.worklist.settings import WorkListSettings
from fieldlink.worklist.window_samples import WindowSamples, figures_of, interval_of

if TYPE_CHECKING:
    from fieldlink.site.recording import Recording

__all__ = ["judge_recordings"]

_Job = tuple[Path, float | None]
"""A recording, and the seconds between its rows where they are given."""


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
        files: recordings, see `fieldlink.site.recording.read_recording`; a loop has the file's
            name.
        settings: see `WorkListSettings`.
        period: seconds between rows; the files' own unless given.
        workers: processes that judge.
        progress: called with a file's name, how many are done, and how many there are.
        diagnose: see `fieldlink.worklist.list_loops`.
        partial: gives the recordings that an earlier run has judged, and keeps those of this one.

    Raises:
        RecordingError: the only file cannot be used; one among others is a row that says so.
        EstimatorError: the only file holds no window of a loop.
    """
    chosen = settings or WorkListSettings()
    names = dict(zip(files, _names(files), strict=True))
    if len(files) == 1:
        progress(names[files[0]], 0, 1)
        return [_reported(names[files[0]], _judge((files[0], period)), chosen, diagnose)]
    found = []
    with _judging([(file, period) for file in files], workers, partial) as results:
        for number, (file, judged) in enumerate(results):
            progress(names[file], number, len(files))
            if isinstance(judged, str):
                found.append(_unusable(names[file], judged, chosen))
            else:
                found.append(_reported(names[file], judged, chosen, diagnose))
    return sorted(found, key=lambda loop: (loop.row.urgency, loop.row.tag))


@contextmanager
def _judging(
    jobs: Sequence[_Job], workers: int, partial: PartialReport | None
) -> Iterator[Iterator[tuple[Path, _Judged | str]]]:
    """Give the results as they come, in other processes where there are several.

    What was judged before comes first; the others are on disk before they are given.
    """
    known = [] if partial is None else [(job, partial.find(*job)) for job in jobs]
    before = [(job, kept) for job, kept in known if kept is not None]
    left = [job for job in jobs if job not in {job for job, _ in before}]

    def give(results: Iterable[tuple[_Job, _Judged | str]]) -> Iterator[tuple[Path, _Judged | str]]:
        for job, kept in before:
            yield job[0], _of_kept(job, kept)
        for job, judged in results:
            if partial is not None:
                partial.keep(*job, _kept(judged))
            yield job[0], judged

    if workers < 2 or not left:
        yield give((job, _judge_or_explain(job)) for job in left)
        return
    with ProcessPoolExecutor(min(workers, len(left)), get_context("spawn")) as pool:
        futures = {pool.submit(_judge_or_explain, job): job for job in left}
        try:
            yield give((futures[done], done.result()) for done in as_completed(futures))
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


def _of_kept(job: _Job, kept: Mapping[str, Any]) -> _Judged | str:
    """Return a result again; the samples are read from the recording."""
    if "problem" in kept:
        return str(kept["problem"])
    recording = _read(job)
    stem = None if kept["stem"] is None else np.asarray(kept["stem"], float)
    samples = _samples(recording, stem)
    return _Judged(samples, dict(kept["document"]), tuple(kept["notes"]))


def _names(files: Sequence[Path]) -> list[str]:
    """Return the files' names without ending; with the folder where two names are the same."""
    stems = [file.stem for file in files]
    return [
        as_text(stem if stems.count(stem) == 1 else str(file.with_suffix("")))
        for stem, file in zip(stems, files, strict=True)
    ]


def _judge_or_explain(job: _Job) -> _Judged | str:
    """Judge a recording; return a sentence where that fails, so that the others go on."""
    try:
        return _judge(job)
    except (FieldlinkError, EstimatorError) as error:
        return as_text(str(error))


def _unusable(name: str, problem: str, settings: WorkListSettings) -> ReportedLoop:
    """The row of a recording that cannot be used."""
    cause = Cause(Wrong.UNREADABLE, ("the recording cannot be used",))
    finding = Finding((cause,), (problem,), is_sure=False)
    row = WorkRow(tag=name, device="", finding=finding, limit=settings.stick_band_limit)
    return ReportedLoop(row, None, None, None, settings.span_of())


def _read(job: _Job) -> Recording:
    from fieldlink.site.missing_rows import fill_missing_rows
    from fieldlink.site.recording import read_recording

    file, period = job
    return keep_newest(fill_missing_rows(read_recording(file, period=period)))


def _judge(job: _Job) -> _Judged:
    from estimator import identify

    recording = _read(job)
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
