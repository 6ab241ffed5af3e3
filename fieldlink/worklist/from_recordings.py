"""The work list of recorded loops: one file a loop, each judged by the estimator now."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from estimator import EstimatorError, Interval
from fieldlink.errors import FieldlinkError
from fieldlink.worklist.finding import Cause, Finding, Wrong, finding_of_estimate
from fieldlink.worklist.from_store import Diagnose, ReportedLoop
from fieldlink.worklist.row import Confidence, WorkRow
from fieldlink.worklist.settings import WorkListSettings
from fieldlink.worklist.window_samples import WindowSamples, figures_of, interval_of

__all__ = ["judge_recordings"]


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

    Raises:
        RecordingError: the only file cannot be used; one among others is a row that says so.
        EstimatorError: the only file holds no window of a loop.
    """
    chosen = settings or WorkListSettings()
    names = _names(files)
    jobs = [(file, period) for file in files]
    found = []
    if len(jobs) == 1:
        progress(names[0], 0, 1)
        found.append(_reported(names[0], _judge(jobs[0]), chosen, diagnose))
    else:
        with _judging(jobs, workers) as results:
            for number, (name, judged) in enumerate(zip(names, results, strict=True)):
                progress(name, number, len(files))
                if isinstance(judged, str):
                    found.append(_unusable(name, judged, chosen))
                else:
                    found.append(_reported(name, judged, chosen, diagnose))
    return sorted(found, key=lambda loop: (loop.row.urgency, loop.row.tag))


@contextmanager
def _judging(
    jobs: Sequence[tuple[Path, float | None]], workers: int
) -> Iterator[Iterable[_Judged | str]]:
    """Give the results in the order of the jobs, in other processes where there are several."""
    if workers < 2:
        yield map(_judge_or_explain, jobs)
        return
    with ProcessPoolExecutor(min(workers, len(jobs)), get_context("spawn")) as pool:
        yield pool.map(_judge_or_explain, jobs)


def _names(files: Sequence[Path]) -> list[str]:
    """Stems; with their folder where several files have one stem."""
    stems = [file.stem for file in files]
    return [
        stem if stems.count(stem) == 1 else str(file.with_suffix(""))
        for stem, file in zip(stems, files, strict=True)
    ]


def _judge_or_explain(job: tuple[Path, float | None]) -> _Judged | str:
    """Judge a recording; a sentence where that cannot be done, because others go on."""
    try:
        return _judge(job)
    except (FieldlinkError, EstimatorError) as error:
        return str(error)


def _unusable(name: str, problem: str, settings: WorkListSettings) -> ReportedLoop:
    """The row of a recording that cannot be used."""
    cause = Cause(Wrong.UNDETERMINED, ("the recording cannot be used",))
    finding = Finding((cause,), (problem,), is_sure=False)
    row = WorkRow(tag=name, device="", finding=finding, limit=settings.stick_band_limit)
    return ReportedLoop(row, None, None, None, settings.op_span)


def _judge(job: tuple[Path, float | None]) -> _Judged:
    from estimator import identify
    from fieldlink.site.missing_rows import fill_missing_rows
    from fieldlink.site.recording import read_recording

    file, period = job
    recording = fill_missing_rows(read_recording(file, period=period))
    result = identify(
        recording.op,
        recording.pv,
        sp=recording.sp,
        auto=None if recording.auto is None else recording.auto.astype(float),
        period=recording.period,
    )
    stem = result.stem if result.verdict.value == "stiction" else None
    samples = WindowSamples(recording.op, recording.pv, recording.sp, stem, recording.period)
    return _Judged(samples, result.to_dict(), recording.notes)


def _reported(
    name: str, judged: _Judged, settings: WorkListSettings, diagnose: Diagnose
) -> ReportedLoop:
    document, samples, span = judged.document, judged.samples, settings.op_span
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
