"""The work list of recorded loops: one file a loop, each judged by the estimator now."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from estimator import Interval
from fieldlink.worklist.finding import finding_of_estimate
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
        RecordingError: a file cannot be used.
        EstimatorError: a file holds no window of a loop.
    """
    chosen = settings or WorkListSettings()
    found = []
    names = _names(files)
    jobs = [(file, period) for file in files]
    if workers > 1 and len(files) > 1:
        with ProcessPoolExecutor(min(workers, len(files)), get_context("spawn")) as pool:
            results = pool.map(_judge, jobs)
            for number, (name, judged) in enumerate(zip(names, results, strict=True)):
                progress(name, number, len(files))
                found.append(_reported(name, judged, chosen, diagnose))
    else:
        for number, (name, job) in enumerate(zip(names, jobs, strict=True)):
            progress(name, number, len(files))
            found.append(_reported(name, _judge(job), chosen, diagnose))
    return sorted(found, key=lambda loop: (loop.row.urgency, loop.row.tag))


def _names(files: Sequence[Path]) -> list[str]:
    """Stems; with their folder where several files have one stem."""
    stems = [file.stem for file in files]
    return [
        stem if stems.count(stem) == 1 else str(file.with_suffix(""))
        for stem, file in zip(stems, files, strict=True)
    ]


def _judge(job: tuple[Path, float | None]) -> _Judged:
    from estimator import identify
    from fieldlink.site.recording import read_recording

    file, period = job
    recording = read_recording(file, period=period)
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
