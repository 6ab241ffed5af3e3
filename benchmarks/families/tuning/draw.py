"""One loop from (kind, sticky, seed): process, tuning, valve, disturbances, noise and record."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from benchmarks.families.loop import Law, RecordedLoop
from benchmarks.families.tuning.closed_loop import (
    Controller,
    LoopPart,
    Simulated,
    Valve,
    simulate,
)
from benchmarks.families.tuning.loads import Floats, colour, count_knots, disturb, find_strokes
from benchmarks.families.tuning.process import Process, tune
from benchmarks.families.tuning.records import compress, draw_holes, hold

__all__ = ["HEALTHY_KINDS", "KINDS", "STICKY_KINDS", "draw"]

_ONLY_STICKY = ("pure-slip", "dead-band", "he", "kano", "sliding", "karnopp", "lugre")
_ONLY_HEALTHY = ("tight-tuning",)
_BOTH = (
    *("pi", "integrating", "cascade", "interacting", "sine", "triangle", "sines", "load-steps"),
    *("ramps", "drift", "saturation", "curved", "quantised", "held", "interpolated", "decimated"),
    *("missing", "noisy-op", "sensor-lag", "oscillatory", "few-strokes", "setpoint-steps"),
)
HEALTHY_KINDS = (*_BOTH, *_ONLY_HEALTHY)
STICKY_KINDS = (*_BOTH, *_ONLY_STICKY)
KINDS = (*_BOTH, *_ONLY_STICKY, *_ONLY_HEALTHY)

_OUTSIDE = ("sine", "triangle", "sines", "load-steps", "ramps", "drift", "saturation")

LEAST_STROKES = 4
"""Fewer travels of the stem show no limit cycle; the loop is drawn again."""

MOST_ATTEMPTS = 200
"""Draws of one name before it is given up."""

KNOTS_PER_STROKE = 4
"""A historian's record with fewer stored points per stroke does not show how the stem moved."""

SHORTEST_WINDOW, LONGEST_WINDOW = 500, 1500


@dataclass(frozen=True)
class _Scene:
    """All that is simulated, before noise."""

    parts: tuple[LoopPart, ...]
    sp: Floats
    warm: int
    samples: int
    every: int
    cascade: bool = False
    coupling: tuple[float, float] = (0.0, 0.0)
    quantum: tuple[float, float] = (0.0, 0.0)

    def run(self, part: LoopPart | None = None) -> Simulated:
        """Signals after the warm-up, with another recorded loop if given."""
        parts = self.parts if part is None else (part, *self.parts[1:])
        whole = simulate(
            parts, self.sp, cascade=self.cascade, coupling=self.coupling, quantum=self.quantum
        )
        keep = slice(self.warm, None)
        return Simulated(whole.op[keep], whole.pv[keep], whole.sp[keep], whole.stem[keep])


def draw(kind: str, sticky: bool, seed: int) -> RecordedLoop:
    """Draw the loop of that kind and seed; the same arguments give the same loop.

    Raises:
        ValueError: no such kind, or a kind that is only drawn with the other sort of valve.
    """
    allowed = STICKY_KINDS if sticky else HEALTHY_KINDS
    if kind not in allowed:
        valve = "sticky" if sticky else "healthy"
        raise ValueError(f"no {valve} loops of kind {kind!r}; choose one of {', '.join(allowed)}")
    for attempt in range(MOST_ATTEMPTS):
        rng = np.random.default_rng([zlib.crc32(kind.encode()), int(sticky), seed, attempt])
        loop = _draw_once(kind, sticky, rng)
        if loop is not None:
            return replace(loop, name=f"{kind}-{'s' if sticky else 'h'}{seed}")
    raise RuntimeError(f"{kind} {seed}: no physically sensible loop in {MOST_ATTEMPTS} draws")


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _draw_valve(kind: str, sticky: bool, rng: np.random.Generator) -> Valve:
    curvature = rng.uniform(1.0, 3.5) * rng.choice([-1.0, 1.0]) if kind == "curved" else 0.0
    band = _log_uniform(rng, 2.0, 20.0)
    jump = {"pure-slip": band, "dead-band": 0.0}.get(kind, band * rng.uniform(0.12, 1.0))
    laws, shares = ("he", "kano", "sliding", "karnopp", "lugre"), (0.3, 0.22, 0.22, 0.13, 0.13)
    law = kind if kind in laws else str(rng.choice(laws, p=shares))
    if kind in ("decimated", "pure-slip", "dead-band") and law in ("karnopp", "lugre"):
        # Many scans per sample cost too much, and the physical laws reach these limits only nearly.
        law = "sliding" if kind != "pure-slip" else "he"
    lag = rng.uniform(0.05, 0.4)
    if not sticky:
        return Valve(curvature=curvature)
    return Valve(law, band, jump, lag, curvature)


def _draw_process(kind: str, sticky: bool, every: int, rng: np.random.Generator) -> Process:
    form = "lags"
    level_share = 0.7 if kind == "dead-band" else 0.2
    if kind in ("integrating", "oscillatory"):
        form = kind
    elif kind not in ("pi", "cascade", "sensor-lag") and rng.uniform() < level_share:
        form = "integrating"
    low, high = (12.0, 50.0) if kind == "few-strokes" else (3.0, 40.0)
    lag = _log_uniform(rng, low, high)
    second = lag * rng.uniform(0.05, 0.4) if rng.uniform() < 0.6 else 0.0
    dead = _log_uniform(rng, 0.2, 8.0)
    if form == "integrating":
        lag, second = _log_uniform(rng, 10.0, 100.0), rng.uniform(0.0, 4.0)
    if form == "oscillatory":
        lag, second, dead = _log_uniform(rng, 2.0, 10.0), rng.uniform(0.15, 0.6), min(dead, 3.0)
    if kind == "cascade":
        lag, second, dead = _log_uniform(rng, 1.0, 5.0), 0.0, rng.uniform(0.1, 1.0)
    sensor = lag * rng.uniform(0.4, 1.2) if kind == "sensor-lag" else rng.uniform(0.0, 0.8)
    gain = _log_uniform(rng, 0.3, 3.0) * rng.choice([-1.0, 1.0])
    if every > 1:
        stretch = every * rng.uniform(0.3, 1.0)
        lag, dead = lag * stretch, dead * stretch
        second *= stretch if form != "oscillatory" else 1.0
    return Process(form, float(gain), lag, second, float(sensor), dead)


def _draw_part(
    kind: str, process: Process, valve: Valve, rng: np.random.Generator, scans: int
) -> LoopPart:
    """Tune `process` and give it the small coloured load that every loop has."""
    derivative = rng.uniform(0.2, 0.5) if kind == "noisy-op" or rng.uniform() < 0.2 else 0.0
    if process.form == "oscillatory":
        derivative = 0.0
    tight = kind == "tight-tuning"
    margin = rng.uniform(1.02, 1.2) if tight else rng.uniform(1.8, 3.0)
    gain, integral, rate = tune(process, _log_uniform(rng, 0.7, 3.5), derivative, margin, exact=tight)
    share = _log_uniform(rng, 0.01, 0.15)
    size = share * valve.stick_band if valve.stick_band else 8.0 * share
    load = colour(rng, scans, size, _log_uniform(rng, 3.0, 100.0))
    rest = rng.uniform(35.0, 65.0)
    return LoopPart(process, Controller(gain, integral, rate, rest), valve, load, np.zeros(scans))


def _closed_loop_time(part: LoopPart) -> float:
    """Rough closed-loop time constant in scans, where disturbances hurt."""
    process = part.process
    wait = process.dead_time + 0.5 + process.sensor_lag
    return 2.0 * wait + 0.3 * min(process.lag, 60.0)


def _draw_scene(kind: str, sticky: bool, rng: np.random.Generator) -> _Scene:
    samples = int(rng.integers(SHORTEST_WINDOW, LONGEST_WINDOW + 1))
    every = int(rng.integers(3, 11)) if kind == "decimated" else 1
    if kind == "few-strokes":
        samples = LONGEST_WINDOW
    valve = _draw_valve(kind, sticky, rng)
    process = _draw_process(kind, sticky, every, rng)
    warm = int(min(1500.0, 200.0 + 8.0 * process.lag))
    scans = warm + samples * every
    part = _draw_part(kind, process, valve, rng, scans)
    size = valve.stick_band * rng.uniform(0.3, 1.8) if sticky else _log_uniform(rng, 1.5, 12.0)
    size = min(size, 14.0)
    scale = _closed_loop_time(part)
    load = part.load + disturb(kind, rng, scans, size, scale)
    if kind == "dead-band" and rng.uniform() < 0.5:
        load += colour(rng, scans, 0.5 * valve.stick_band, rng.uniform(20.0, 80.0))
    if kind == "saturation" and sticky:
        load += disturb(kind, rng, scans, valve.stick_band, scale)
    if kind == "few-strokes" and not sticky:
        k = np.arange(scans)
        load += size * np.sin(2.0 * np.pi * (k / rng.uniform(150.0, 350.0) + rng.uniform()))
    if not sticky and kind in ("held", "interpolated", "quantised", "missing", "curved", "decimated"):
        # Something to record: half of these oscillate from outside.
        load += disturb(str(rng.choice(["pi", "sine", "load-steps", "drift"])), rng, scans, size, scale)
    sp = np.zeros(scans)
    if kind == "setpoint-steps":
        sp = abs(process.gain) * disturb("load-steps", rng, scans, max(size, 2.0), scale)
    part = replace(part, load=load)
    scene = _Scene((part,), sp, warm, samples, every)
    if kind == "interacting":
        other_sticks = rng.uniform() < (0.3 if sticky else 0.7)
        near = _draw_process("pi", other_sticks, 1, rng)
        beside = _draw_part("pi", near, _draw_valve("pi", other_sticks, rng), rng, scans)
        coupling = (rng.uniform(0.2, 0.7), rng.uniform(0.0, 0.5) * rng.choice([-1.0, 1.0]))
        scene = replace(scene, parts=(part, beside), coupling=coupling)
    if kind == "cascade":
        slow = _draw_process(str(rng.choice(["pi", "integrating"])), False, 1, rng)
        slow = replace(slow, lag=max(slow.lag, 15.0), dead_time=slow.dead_time + 4.0 + 2.0 * process.lag)
        outer = _draw_part("cascade", slow, Valve(), rng, scans)
        size = rng.uniform(0.0, 6.0)
        outer = replace(outer, load=outer.load + disturb("load-steps", rng, scans, size, scale))
        # The inner loop answers with its own delay; the tuning above allowed for it.
        outer = replace(outer, process=replace(slow, dead_time=slow.dead_time - 4.0 - 2.0 * process.lag))
        scene = replace(scene, parts=(part, outer), cascade=True)
    return scene


def _draw_once(kind: str, sticky: bool, rng: np.random.Generator) -> RecordedLoop | None:
    scene = _draw_scene(kind, sticky, rng)
    part = scene.parts[0]
    cheap = replace(part, valve=replace(part.valve, law="he" if sticky else "none"))
    quiet = scene.run(cheap)
    if not _is_sensible(quiet, part.process.gain):
        return None
    control = part.controller
    if kind == "saturation":
        middle = float(np.median(quiet.op))
        if rng.uniform() < 0.5:
            control = replace(control, high=middle + (quiet.op.max() - middle) * rng.uniform(0.6, 0.9))
        else:
            control = replace(control, low=middle - (middle - quiet.op.min()) * rng.uniform(0.6, 0.9))
    cycle = max(float(np.std(quiet.pv)), 0.1 * abs(part.process.gain))
    share = _log_uniform(rng, 0.003, 0.34)
    wanted = share * cycle
    # Noise that shakes OP by more than this would be filtered by any engineer.
    reach = (0.3 * part.valve.stick_band if sticky else 2.0) / abs(control.gain)
    noise = min(wanted, reach)
    if kind == "noisy-op":
        noise = reach * rng.uniform(0.5, 1.5)
    if kind == "quantised":
        high = max(float(np.ptp(quiet.pv)), 0.5 * abs(part.process.gain))
        scene = replace(
            scene,
            quantum=(_log_uniform(rng, 0.1, 1.0), high * _log_uniform(rng, 0.01, 0.15)),
        )
    part = replace(part, controller=control, noise=noise * rng.standard_normal(len(scene.sp)))
    signals = scene.run(part)
    if not _is_sensible(signals, part.process.gain, allow_limits=kind == "saturation"):
        return None
    limited = _share_at(signals.op, control.low, control.high)
    if kind == "saturation" and not 0.03 < limited < 0.7:
        return None
    return _record(kind, scene, part, signals, noise / cycle, rng)


def _share_at(op: Floats, low: float, high: float) -> float:
    return float(np.mean((op <= low + 1e-9) | (op >= high - 1e-9)))


def _is_sensible(signals: Simulated, gain: float, *, allow_limits: bool = False) -> bool:
    if not np.isfinite(signals.pv).all() or np.ptp(signals.pv) > 80.0 * max(abs(gain), 1.0):
        return False
    return allow_limits or _share_at(signals.op, 0.0, 100.0) < 0.01


def _record(
    kind: str,
    scene: _Scene,
    part: LoopPart,
    signals: Simulated,
    noise_share: float,
    rng: np.random.Generator,
) -> RecordedLoop | None:
    valve, every = part.valve, scene.every
    sticky = valve.law != "none"
    threshold = max(0.5 * valve.slip_jump, 0.1 * valve.stick_band)
    if not sticky:
        threshold = max(0.5, 0.25 * float(np.ptp(signals.stem)))
    starts = find_strokes(signals.stem, threshold)
    end = len(signals.stem)
    if kind == "few-strokes":
        wanted = int(rng.integers(LEAST_STROKES, 9))
        if len(starts) > wanted:
            end = int(starts[wanted])
        if end < SHORTEST_WINDOW:
            return None
    strokes = int(np.sum(starts < end))
    if strokes < LEAST_STROKES and (sticky or kind == "few-strokes"):
        return None
    op, pv, sp = (s[:end:every].copy() for s in (signals.op, signals.pv, signals.sp))
    notes = _describe(part, scene, noise_share)
    assessable = len(op) / max(strokes, 1) >= KNOTS_PER_STROKE
    if kind in ("held", "interpolated"):
        sizes = [_log_uniform(rng, 0.1, 1.0) * float(np.std(s)) for s in (op, pv)]
        if kind == "held":
            op, pv = (np.asarray(hold(s, d)) for s, d in zip((op, pv), sizes, strict=True))
        else:
            op, pv = (np.asarray(compress(s, d, 120)) for s, d in zip((op, pv), sizes, strict=True))
        knots = min(count_knots(op), count_knots(pv)) // (2 if kind == "held" else 1)
        assessable = knots >= KNOTS_PER_STROKE * max(strokes, LEAST_STROKES)
        notes += f", {knots} stored points"
    if kind == "missing":
        holes = draw_holes(rng, len(op), rng.uniform(0.05, 0.3))
        op[holes] = pv[holes] = np.nan
    if kind == "saturation":
        share = _share_at(signals.op, part.controller.low, part.controller.high)
        notes += f", {100 * share:.0f} % of the time at a limit"
    known = rng.uniform() < (0.85 if kind == "cascade" else 0.6) or kind == "setpoint-steps"
    return RecordedLoop(
        name=kind,
        kind=kind,
        op=op,
        pv=pv,
        sp=sp if known else None,
        period=float(rng.choice([0.5, 1.0, 2.0, 5.0, 10.0])) * every,
        stick_band=valve.stick_band,
        slip_jump=valve.slip_jump,
        law=cast(Law, valve.law),
        assessable=assessable,
        strokes=strokes,
        notes=notes,
    )


def _describe(part: LoopPart, scene: _Scene, noise_share: float) -> str:
    p, c = part.process, part.controller
    text = (
        f"{p.form}, K {p.gain:.2f}, lag {p.lag:.1f}, dead time {p.dead_time:.1f} scans; "
        f"Kc {c.gain:.2f}, Ti {c.integral_time:.1f}, Td {c.derivative_time:.1f}; "
        f"noise {100 * noise_share:.1f} % of the cycle"
    )
    return text + (f"; every {scene.every}th scan" if scene.every > 1 else "")
