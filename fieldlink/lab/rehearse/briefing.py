"""The first page of a report, in words: what was rehearsed, what was found, what to do on site."""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fieldlink.lab.rehearse.happenings import Disable, Manual, Points, Repair
from fieldlink.lab.rehearse.load import ScenarioFile
from fieldlink.lab.rehearse.models import Scenario
from fieldlink.lab.rehearse.outcome import RunCourse
from fieldlink.lab.rehearse.run import Rehearsal
from fieldlink.site.models import EstimatorSettings
from fmu_models import FmuSummary, catalogue, fmu_path, summarise

__all__ = ["describe_scene", "find_unit", "list_findings", "list_site_work"]

_SETTLING = 0.1
"""Part of a window that is left out after a change of hands or of the set-point, when PV is
compared: a window holds several cycles, so this is longer than one loop takes to settle."""
_NETWORK = {
    "drop": "polls without an answer",
    "late": "polls that get the cycle before",
    "write_lost": "writes that get lost",
    "write_flipped": "blocks of which a bit changes on the way",
    "write_torn": "blocks of which half arrives",
    "restart": "a PLC that is off, and starts with empty registers",
}
_REASONS = {
    "none": "for no stated reason",
    "expired": "the block had expired",
    "heartbeat_dead": "the daemon was silent",
    "operator": "the operator withdrew it",
    "no_stiction": "the valve was found healthy",
    "pv_bad": "PV was no number",
    "pv_frozen": "PV repeated one value",
    "solver": "its solver took too long",
    "worse": "PV deviated more than before",
    "no_gain": "PV deviated more than half as much as before",
    "growing": "the oscillation grew",
    "hunting": "the stem travelled more for no gain",
    "travel": "the stem travelled more than its budget",
    "wrong_sign": "PV answered to OP the other way round",
    "left_range": "PV left its known range",
    "refused": "the model could not be used",
}
_SENSOR = {
    "freeze": "stands still",
    "drift": "drifts",
    "spikes": "has spikes",
    "noise": "has noise",
    "bad": "gives no number",
}


def _fmu(file: ScenarioFile) -> FmuSummary:
    name = file.scenario.plant.fmu
    return summarise(fmu_path(name) if name in catalogue else file.path.parent / Path(name))


def find_unit(file: ScenarioFile) -> str:
    """Return the unit of PV, empty where the FMU names none."""
    variable = _fmu(file).variable(file.scenario.plant.variables.pv)
    unit = variable.unit if variable is not None else ""
    return "" if unit == "1" else unit


def describe_scene(file: ScenarioFile) -> list[str]:
    """Return what was rehearsed, one sentence a line."""
    scenario = file.scenario
    plant, controller, daemon = scenario.plant, scenario.controller, scenario.daemon
    about = textwrap.shorten(_fmu(file).description.rstrip("."), 120, placeholder=" ...")
    lines = [
        f"Plant: {plant.fmu}{f' ({about})' if about else ''}, scanned every {plant.period:g} s."
    ]
    if controller.kind == "pi":
        unit = find_unit(file) or "unit of PV"
        tuned = (
            f"PI, gain {controller.gain:.3g} % per {unit}, integral time "
            f"{controller.integral_time:.3g} s"
        )
    else:
        tuned = "MPC that knows the process and not the valve"
    spare = "; the compensator may take over" if controller.compensate else ""
    lines.append(f"Controller: {tuned}{spare}.")
    if scenario.valve is not None:
        place = ", in front of the FMU" if scenario.valve.in_front else ""
        lines.append(
            f"Valve: stick band S {_course(scenario.valve.stick_band)}, slip jump J "
            f"{_course(scenario.valve.slip_jump)}, percent of OP{place}."
        )
    lines += _incidents(scenario)
    written = "model written to the PLC" if daemon.write_back else "nothing written"
    lines.append(
        f"Fieldlink: windows of {daemon.window} samples ({_hours(daemon.window * plant.period)}), "
        f"{written}."
    )
    return lines


def _incidents(scenario: Scenario) -> list[str]:
    lines = []
    load = scenario.load
    if any(value for _, value in load.points) or load.sinusoids:
        swings = "".join(
            f", a swing of {s.amplitude:g} every {s.period:g} s" for s in load.sinusoids
        )
        lines.append(f"Load: {_course(load.points)}{swings}.")
    for fault in scenario.sensor:
        size = f" of {fault.size:.3g} (standard deviation)" if fault.kind == "noise" else ""
        whole = fault.begin == 0.0 and fault.end >= scenario.scenario.duration
        span = "throughout" if whole else f"from {fault.begin:g} to {fault.end:g} s"
        lines.append(f"Transmitter {_SENSOR[fault.kind]}{size} {span}.")
    for trouble in scenario.network:
        share = f", {trouble.share:.0%} of them" if trouble.share < 1.0 else ""
        lines.append(
            f"Network: {_NETWORK[trouble.kind]} from {trouble.begin:g} to {trouble.end:g} s{share}."
        )
    for event in scenario.maintenance:
        if isinstance(event, Repair):
            lines.append(
                f"The valve is repaired at {event.at:g} s (S {event.stick_band:g} % then)."
            )
        elif isinstance(event, Manual):
            moved = "" if event.op is None else f", OP {_course(event.op)}"
            lines.append(
                f"An operator has the loop from {event.begin:g} to {event.end:g} s{moved}."
            )
        elif isinstance(event, Disable):
            lines.append(f"Writing is disabled from {event.begin:g} to {event.end:g} s.")
    for wrong in scenario.misestimate:
        sign = ", gain of the wrong sign" if wrong.gain_factor < 0.0 else ""
        lines.append(f"A wrong model is identified from {wrong.begin:g} to {wrong.end:g} s{sign}.")
    return lines


def list_findings(rehearsal: Rehearsal, unit: str) -> list[tuple[str, str]]:
    """Return what was found: a name and a value with its unit."""
    course = rehearsal.course
    counts = Counter(window.verdict or "refused" for window in course.windows)
    words = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in counts.most_common())
    rows = [("Windows judged", words or "none")]
    sticky = [w for w in course.windows if w.verdict == "stiction"]
    known = [w for w in sticky if math.isfinite(w.stick_band.value)]
    if known:
        last = known[-1]
        true, sure = _true(course, last.end), 100.0 * EstimatorSettings().confidence
        rows.append(
            (
                "Stick band S, last found",
                f"{last.stick_band.value:.3g} % of OP, {sure:g} % interval "
                f"{last.stick_band.low:.3g} to {last.stick_band.high:.3g} %{true}",
            )
        )
    accepted = [r.utc_ms / 1000.0 for r in course.writebacks if r.outcome == "accepted"]
    if course.writebacks:
        times = f", at {', '.join(f'{t:g}' for t in accepted[:4])} s" if accepted else ""
        held = Counter(
            r.reason for r in course.writebacks if r.outcome not in ("accepted", "committed")
        )
        why = f": {held.most_common(1)[0][0]}" if held else ""
        often = f" ({held.most_common(1)[0][1]} times)" if len(held) > 1 else ""
        rows.append(
            (
                "Blocks accepted by the PLC",
                f"{len(accepted)}{times}; {held.total()} not written or not taken over{why}{often}",
            )
        )
    rows += _compensation(course, unit, rehearsal.file.scenario.daemon.window)
    return rows


def _compensation(course: RunCourse, unit: str, window: int) -> list[tuple[str, str]]:
    trend, mark = course.trend, f" {unit}" if unit else ""
    error = trend.pv - trend.sp
    settled = _settled(course, round(window * _SETTLING)) & np.isfinite(error)
    first = int(np.argmax(trend.compensated)) if trend.compensated.any() else trend.time.size
    before = settled & ~trend.compensated & trend.automatic
    before[first:] = False
    with_it = settled & trend.compensated
    rows = []
    for words, chosen in (("the controller, before", before), ("the compensator", with_it)):
        if chosen.any():
            spread = f"{np.std(error[chosen]):.3g}{mark}"
            rows.append((f"PV around SP under {words} (standard deviation, settled)", spread))
    if trend.compensated.any():
        share = trend.compensated.sum() / trend.time.size
        begin = trend.time[first]
        ends = _given_back(course)
        last = (
            f"; last given back at {trend.time[ends[-1] + 1]:g} s, {_why(course, ends[-1])}"
            if ends.size
            else ""
        )
        held = f"from {begin:g} s, {share:.0%} of the time{last}"
        rows.append(("Compensator had the loop", held))
    return rows


def _settled(course: RunCourse, scans: int) -> NDArray[np.bool_]:
    """Mark the scans at least ``scans`` after the last change of hands or of the set-point."""
    trend = course.trend
    changed = np.zeros(trend.time.size, dtype=bool)
    for signal in (trend.compensated, trend.automatic, trend.sp):
        changed[1:] |= (signal[1:] != signal[:-1]) & ~(
            np.isnan(signal[1:].astype(float)) & np.isnan(signal[:-1].astype(float))
        )
    last = np.maximum.accumulate(np.where(changed, np.arange(changed.size), 0))
    return np.arange(changed.size) - last >= scans


def _true(course: RunCourse, end: float) -> str:
    trend = course.trend
    k = int(np.searchsorted(trend.time, end)) - 1
    value = float(trend.stick_band[max(k, 0)])
    return f" (true: {value:.3g} %)" if math.isfinite(value) else ""


def list_site_work(rehearsal: Rehearsal) -> list[str]:
    """Return what a control engineer does with this on site, in order."""
    scenario, course = rehearsal.file.scenario, rehearsal.course
    period, window = scenario.plant.period, scenario.daemon.window
    failed = [finding for finding in rehearsal.findings if not finding.passed]
    lines = []
    if rehearsal.defect is not None:
        found = (
            f"{len(failed)} of {len(rehearsal.findings)} expectations show it"
            if failed
            else "no expectation shows it, so add one that does"
        )
        lines.append(
            f"This run has a defect on purpose: {found}. Compare it with the run without the "
            "defect, and go by that one."
        )
    elif failed:
        lines.append(
            f"Do not go yet: {len(failed)} of {len(rehearsal.findings)} expectations are not met. "
            "Change the settings or the scenario until they are."
        )
    lines.append(
        "Enter the addresses of OP, PV, SP, mode and scan counter of the real loop in the register "
        f"map, and the loop's period of {period:g} s; check with: fieldlink check site.toml."
    )
    lines.append(
        f"Let fieldlink only read at first (writeback.enabled = false). A first verdict takes "
        f"{_hours(window * period)} in automatic, with the oscillation in the window."
    )
    if any(w.verdict == "stiction" for w in course.windows):
        lines.append(
            "A verdict of stiction: check the packing, the positioner and the air supply before "
            "anything is compensated, and compare S with a stroke test in manual."
        )
    if any(w.verdict == "not_assessable" for w in course.windows):
        lines.append(
            "A window that is not assessable says why; it does not clear the valve. Wait for one "
            "with OP moving, or move the set-point."
        )
    if scenario.daemon.write_back:
        S, J = scenario.daemon.stick_band, scenario.daemon.slip_jump
        lines.append(
            f"Before writing: the operator's enable register works, the limits of S ({S[0]:g} to "
            f"{S[1]:g} %) and J ({J[0]:g} to {J[1]:g} %) suit the valve, and somebody watches the "
            "first block."
        )
    ends = _given_back(course)
    if ends.size:
        reasons = sorted({_why(course, k) for k in ends})
        times = "once" if ends.size == 1 else f"{ends.size} times"
        lines.append(
            f"The compensator gave the loop back {times} ({', '.join(reasons)}): show the "
            "operators how that looks, and that the controller has the loop then."
        )
    return lines


def _given_back(course: RunCourse) -> NDArray[np.intp]:
    """Return the last scans of the compensator before it gave the loop back.

    Where an operator takes the loop, nothing is given back.
    """
    trend = course.trend
    return np.flatnonzero(trend.compensated[:-1] & ~trend.compensated[1:] & trend.automatic[1:])


def _why(course: RunCourse, scan: int) -> str:
    return _REASONS.get(course.trend.reason[scan + 1], "the PLC was off")


def _course(points: Points) -> str:
    if len({value for _, value in points}) == 1:
        return f"{points[0][1]:g}"
    return " to ".join(f"{value:g} at {time:g} s" for time, value in points)


def _hours(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:g} s"
    return f"{seconds / 60.0:.3g} min" if seconds < 7200.0 else f"{seconds / 3600.0:.3g} h"
