"""Runs a scenario: the real daemon in lockstep with a simulated PLC, and the result."""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fieldlink.daemon import DaemonStatus, LockstepRun
from fieldlink.lab.plc import PlcError
from fieldlink.lab.rehearse.errors import ScenarioError
from fieldlink.lab.rehearse.estimating import RehearsalEstimator
from fieldlink.lab.rehearse.injected_defects import Defect
from fieldlink.lab.rehearse.injection import inject_into_scene
from fieldlink.lab.rehearse.judge import Finding, judge
from fieldlink.lab.rehearse.load import ScenarioFile
from fieldlink.lab.rehearse.network import RehearsalLink
from fieldlink.lab.rehearse.outcome import RunCourse, Window, track_of
from fieldlink.lab.rehearse.simulated_site import SimulatedSite, Trend
from fieldlink.lab.rehearse.site_files import LOOP, write_site
from fieldlink.links import Clock, Link
from fieldlink.site import Site
from fieldlink.store import EstimateRecord, EventRecord, Record, SampleRecord, WritebackRecord

__all__ = ["Rehearsal", "rehearse"]


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """The result of a rehearsal.

    Attributes:
        file: the scenario.
        defect: what was broken on purpose.
        course: what happened.
        findings: one for each expectation of the scenario, in its order.
        seconds: wall seconds that it took.
        site_text: the site file that was run.
    """

    file: ScenarioFile
    defect: Defect | None
    course: RunCourse
    findings: tuple[Finding, ...]
    seconds: float
    site_text: str

    @property
    def passed(self) -> bool:
        """Whether everything came as expected."""
        return all(finding.passed for finding in self.findings)

    def to_dict(self) -> dict[str, object]:
        """The JSON object of ``fieldlink rehearse --json``: plain types, null for no number."""
        return {
            "scenario": self.file.name,
            "title": self.file.scenario.scenario.title,
            "defect": self.defect,
            "passed": self.passed,
            "plant_seconds": self.file.scenario.scenario.duration,
            "seconds": round(self.seconds, 3),
            "expectations": [finding.to_dict() for finding in self.findings],
            "windows": [window.to_dict() for window in self.course.windows],
            "writebacks": [
                {"time": r.utc_ms / 1000.0, "outcome": r.outcome, "status": r.status}
                for r in self.course.writebacks
            ],
            "events": [
                {"time": r.utc_ms / 1000.0, "event": r.kind, "message": r.message}
                for r in self.course.events
            ],
        }


def rehearse(
    file: ScenarioFile,
    *,
    inject: Defect | None = None,
    progress: Callable[[float], None] | None = None,
) -> Rehearsal:
    """Run a scenario in virtual time; the same scenario gives the same result.

    Args:
        file: the scenario.
        inject: something to break on purpose.
        progress: called with the share of the run that is done.

    Raises:
        SiteError, ScenarioError: the scenario cannot be run as it is.
    """
    try:
        return _rehearse(file, inject, progress)
    except (PlcError, ScenarioError) as error:
        said = str(error).replace(f"loop {LOOP}: ", "")
        raise ScenarioError(f"{file.path}: {said}") from error


def _rehearse(
    file: ScenarioFile, inject: Defect | None, progress: Callable[[float], None] | None
) -> Rehearsal:
    begun = time.monotonic()
    scenario = file.scenario
    if inject is not None:
        scenario = inject_into_scene(scenario, inject)
    with tempfile.TemporaryDirectory(prefix="fieldlink-rehearse-") as folder:
        site = write_site(scenario, file.path, Path(folder))
        site_text = site.path.read_text("utf-8")
        stage = SimulatedSite(scenario, site, LOOP, inject)
        records: list[Record] = []

        def links(site: Site, device: str, clock: Clock) -> Link:
            return RehearsalLink(site, device, clock, stage=stage, scenario=scenario, defect=inject)

        run = LockstepRun(
            site,
            estimator=RehearsalEstimator(scenario, inject, lambda: stage.time),
            on_record=records.append,
            links=links,
        )
        duration = scenario.scenario.duration

        def said(now: float) -> None:
            if progress is not None:
                progress(now / duration)

        try:
            status = asyncio.run(run.run(duration, said))
        finally:
            stage.close()
    course = _course(scenario.plant.period, stage, status, records)
    # Judged by the scenario as written, without the defect.
    findings = tuple(judge(expected, course) for expected in file.scenario.expect)
    return Rehearsal(file, inject, course, findings, time.monotonic() - begun, site_text)


def _course(
    period: float, stage: SimulatedSite, status: DaemonStatus, records: Sequence[Record]
) -> RunCourse:
    estimates = [record for record in records if isinstance(record, EstimateRecord)]
    first = next((record.slot for record in records if isinstance(record, SampleRecord)), 0)
    windows = tuple(Window.of(record, period, first) for record in estimates)
    return RunCourse(
        trend=Trend.of(stage.moments),
        windows=windows,
        writebacks=tuple(r for r in records if isinstance(r, WritebackRecord)),
        events=tuple(r for r in records if isinstance(r, EventRecord)),
        counts=status.loops[LOOP].counts,
        track=track_of(windows),
    )
